// Surface points of one geom under the pixels of a block, and their colour: textures, linear light and sRGB. For use in
// *.isa.cpp only.
#pragma once

#include "lane_memory.hpp"
#include "resolve.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

struct Surface {  // points of one geom under the pixels of a block
    F t;
    I mask;
    Vec<F> d;   // ray in C
    Vec<F> local, gradient;  // point and outward direction in the local frame of the geom (DrawnGeom)
    Vec<F> normal;           // unit, in C, towards the camera
};

HIL_INLINE F length_of(const Vec<F> &v) { return sqrt(max(dot(v, v), splat<F>(1e-30f))); }

struct Rgb {
    F r, g, b;
};

// sRGB code / 255 to linear, by a cubic (within 1.2e-3 of the curve of IEC 61966-2-1 up to 1).
HIL_INLINE float decode(float c) { return c * (c * (c * 0.305306011f + 0.682171111f) + 0.012522878f); }

// Linear to sRGB codes 0..255 in three bytes: a rational fit in sqrt(x), within 0.7 of a code of the curve. The three
// quotients share one division.
HIL_INLINE I encode(const Rgb &c) {
    const F zero = splat<F>(0), one = splat<F>(1);
    const auto root = [&](const F &x) { return sqrt(min(max(x, zero), one)); };
    const auto over = [](const F &s) { return s * (s * (s * 74.8932967f + 20.5008569f) - 0.0527410168f); };
    const auto under = [](const F &s) { return s * (s * 84.3211935f + 9.77384834f) + 1.0f; };
    const F r = root(c.r), g = root(c.g), b = root(c.b), ur = under(r), ug = under(g), ub = under(b);
    const F rg = ur * ug, per = 255.0f / (rg * ub);
    const auto code = [&](const F &x) { return truncate(min(x + 0.5f, splat<F>(255))); };
    return code(over(r) * (ug * ub * per)) | shift_left(code(over(g) * (ur * ub * per)), 8) |
           shift_left(code(over(b) * (rg * per)), 16);
}

// Index of a texel in an image 2^power wide. Images are stored in squares of 4 x 4, one cache line each.
HIL_INLINE I texel_at(const I &row, const I &column, const I &power) {
    return shift_left(shift_left(shift_right(row, 2), power - (std::int32_t)2) + shift_right(column, 2), 4) +
           shift_left(row & (std::int32_t)3, 2) + (column & (std::int32_t)3);
}

// Colour of the surface, linear.
HIL_INLINE Rgb albedo(const DrawnGeom &g, const Appearance &look, const Scenery &scenery, const Surface &s, float pixel_angle_rad,
                      const F &mesh_u, const F &mesh_v, bool mesh_uv) {
    const float base[3] = {look.rgb[0], look.rgb[1], look.rgb[2]};
    if (look.texture < 0) return {splat<F>(decode(base[0])), splat<F>(decode(base[1])), splat<F>(decode(base[2]))};
    const Texture &texture = scenery.textures.data()[look.texture];
    // The geom's axis nearest to the normal; the two others give the coordinates [m].
    const F nx = abs(s.gradient.x), ny = abs(s.gradient.y), nz = abs(s.gradient.z);
    const I along_z = (nz >= nx) & (nz >= ny), along_x = ~along_z & (nx >= ny);
    Vec<F> p = s.local;
    float edge[3] = {2.0f * g.half[0], 2.0f * g.half[1], 2.0f * g.half[2]};
    if (g.shape == Shape::kEllipsoid) {
        p = {p.x * g.half[0], p.y * g.half[1], p.z * g.half[2]};
    } else if (g.shape == Shape::kSphere) {
        edge[0] = edge[1] = edge[2] = 2.0f * g.radius;
    } else if (g.shape == Shape::kCapsule || g.shape == Shape::kCylinder) {
        edge[0] = edge[1] = 2.0f * g.radius;
    } else if (g.shape == Shape::kMesh) {
        for (int i = 0; i < 3; ++i) edge[i] = g.mesh->box.hi[i] - g.mesh->box.lo[i];
    }
    I cube_face = splat<I>(0);
    F u, v, du = splat<F>(1), dv = du;  // du, dv: copies of the texture per metre
    if (mesh_uv) {
        u = mesh_u * look.repeat[0];
        v = mesh_v * look.repeat[1];
        du = splat<F>(look.repeat[0] * g.mesh->uv_per_m);
        dv = splat<F>(look.repeat[1] * g.mesh->uv_per_m);
    } else if (texture.cube) {
        // Cube map by direction from the middle of the geom's box; faces and their axes as in OpenGL.
        const auto per_half = [&](const F &x, int i) { return x * (edge[i] > 0.0f && edge[i] < 1e6f ? 2.0f / edge[i] : 1.0f); };
        const F qx = per_half(p.x, 0), qy = per_half(p.y, 1), qz = per_half(p.z, 2);
        const F ax = abs(qx), ay = abs(qy), az = abs(qz);
        const I face_z = (az >= ax) & (az >= ay), face_x = ~face_z & (ax >= ay);
        const F major = select(face_x, qx, select(face_z, qz, qy));
        const F half_per = 0.5f / max(abs(major), splat<F>(1e-20f));
        u = select(face_x, -copysign(splat<F>(1), qx) * qz, select(face_z, copysign(splat<F>(1), qz) * qx, qx));
        v = select(face_x | face_z, qy, -copysign(splat<F>(1), qy) * qz);
        u = u * half_per + 0.5f;
        v = v * half_per + 0.5f;
        // Keep u and v below 1: the far edge belongs to this face, not to the next copy.
        u = min(u, splat<F>(0.99999f));
        v = min(v, splat<F>(0.99999f));
        const float largest = edge[0] > edge[1] ? (edge[0] > edge[2] ? edge[0] : edge[2]) : (edge[1] > edge[2] ? edge[1] : edge[2]);
        du = splat<F>(largest > 0.0f && largest < 1e6f ? 1.0f / largest : 1.0f);
        dv = du;
        cube_face = select(face_x, splat<I>(0), select(face_z, splat<I>(4), splat<I>(2))) + ((major < splat<F>(0)) & splat<I>(1));
    } else {
        u = select(along_x, p.y, p.x);
        v = select(along_z, p.y, p.z);
        const F ex = splat<F>(edge[0] > 0.0f && edge[0] < 1e6f ? 1.0f / edge[0] : 1.0f);
        const F ey = splat<F>(edge[1] > 0.0f && edge[1] < 1e6f ? 1.0f / edge[1] : 1.0f);
        const F ez = splat<F>(edge[2] > 0.0f && edge[2] < 1e6f ? 1.0f / edge[2] : 1.0f);
        if (look.per_metre) {
            // MuJoCo's unit of length for this is 2 m.
            du = splat<F>(0.5f * look.repeat[0]);
            dv = splat<F>(0.5f * look.repeat[1]);
        } else {
            du = select(along_x, ey, ex) * look.repeat[0];
            dv = select(along_z, ey, ez) * look.repeat[1];
        }
        // The first image begins at the corner of least u and greatest v.
        const auto half = [&](int i) { return splat<F>(edge[i] < 1e6f ? 0.5f * edge[i] : 0.0f); };
        u = (u + select(along_x, half(1), half(0))) * du;
        v = (v - select(along_z, half(1), half(2))) * dv;
    }
    const int width = texture.width, height = texture.cube ? texture.width : texture.height;
    // Level by the texels that one pixel covers: the finest level with at most about 1.5 along an edge.
    const F length = length_of(s.d), range = s.t * length;
    const F facing = max(abs(dot(s.normal, s.d)) * (1.0f / length), splat<F>(0.15f));
    const F covered = range * pixel_angle_rad * max(du * (float)width, dv * (float)height) / facing * 0.7f;
    I level = shift_right(as<I>(max(covered, splat<F>(1))), 23) - (std::int32_t)126;
    level = select(covered < splat<F>(1), splat<I>(0), level);
    level = select(level > splat<I>(texture.levels - 1), splat<I>(texture.levels - 1), level);
    // A mesh may have any texture coordinates; converting those out of the range of an int depends on the machine.
    u = select(abs(u) < splat<F>(1e6f), u - floor(u), splat<F>(0));
    v = select(abs(v) < splat<F>(1e6f), v - floor(v), splat<F>(0));
    const I one = splat<I>(1), w = shift_right(splat<I>(width), level), h = shift_right(splat<I>(height), level);
    const I column = truncate(u * to_float(w)) & (w - one);
    I row = h - one - (truncate(v * to_float(h)) & (h - one));
    if (texture.cube) row = row + h * cube_face;
    const I zero = splat<I>(0);
    const I at = select(s.mask, look_up(texture.offset, select(s.mask, level, zero)) + texel_at(row, column, splat<I>(__builtin_ctz((unsigned)width)) - level), zero);
    const I packed = gather(texture.texel.data(), at);
    const auto channel = [&](int shift, float tint) {
        const F root = to_float(shift_right(packed, shift) & (std::int32_t)1023);
        return root * root * (decode(tint) * (1.0f / (1023.0f * 1023.0f)));
    };
    return {channel(0, base[0]), channel(10, base[1]), channel(20, base[2])};
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
