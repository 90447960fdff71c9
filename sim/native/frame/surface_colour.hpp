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

// Position on a texture: coordinates, copies of the texture per metre, and the directions in the local frame in which the
// coordinates grow (unit; not for cube maps).
struct TexturePlace {
    F u, v, du, dv;
    I cube_face;
    Vec<F> along_u, along_v;
};

// Coordinates and gradients of a mesh's texture, by triangle.
struct MeshTexture {
    F u, v;
    Vec<F> along_u, along_v;  // unit
};

HIL_INLINE TexturePlace place_on(const DrawnGeom &g, const Appearance &look, const Surface &s, bool cube, const MeshTexture *on_mesh) {
    TexturePlace at;
    at.cube_face = splat<I>(0);
    at.du = at.dv = splat<F>(1);
    const F zero = splat<F>(0), one = splat<F>(1);
    if (on_mesh != nullptr) {
        at.u = on_mesh->u * look.repeat[0];
        at.v = on_mesh->v * look.repeat[1];
        at.du = splat<F>(look.repeat[0] * g.mesh->uv_per_m);
        at.dv = splat<F>(look.repeat[1] * g.mesh->uv_per_m);
        at.along_u = on_mesh->along_u;
        at.along_v = on_mesh->along_v;
        return at;
    }
    // The geom's axis nearest to the normal; the two others give the coordinates [m].
    const F nx = abs(s.gradient.x), ny = abs(s.gradient.y), nz = abs(s.gradient.z);
    const I along_z = (nz >= nx) & (nz >= ny), along_x = ~along_z & (nx >= ny);
    at.along_u = {select(along_x, zero, one), select(along_x, one, zero), zero};
    at.along_v = {zero, select(along_z, one, zero), select(along_z, zero, one)};
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
    if (cube) {
        // Cube map by direction from the middle of the geom's box; faces and their axes as in OpenGL.
        const auto per_half = [&](const F &x, int i) { return x * (edge[i] > 0.0f && edge[i] < 1e6f ? 2.0f / edge[i] : 1.0f); };
        const F qx = per_half(p.x, 0), qy = per_half(p.y, 1), qz = per_half(p.z, 2);
        const F ax = abs(qx), ay = abs(qy), az = abs(qz);
        const I face_z = (az >= ax) & (az >= ay), face_x = ~face_z & (ax >= ay);
        const F major = select(face_x, qx, select(face_z, qz, qy));
        const F half_per = 0.5f / max(abs(major), splat<F>(1e-20f));
        at.u = select(face_x, -copysign(one, qx) * qz, select(face_z, copysign(one, qz) * qx, qx));
        at.v = select(face_x | face_z, qy, -copysign(one, qy) * qz);
        at.u = at.u * half_per + 0.5f;
        at.v = at.v * half_per + 0.5f;
        // Keep u and v below 1: the far edge belongs to this face, not to the next copy.
        at.u = min(at.u, splat<F>(0.99999f));
        at.v = min(at.v, splat<F>(0.99999f));
        const float largest = edge[0] > edge[1] ? (edge[0] > edge[2] ? edge[0] : edge[2]) : (edge[1] > edge[2] ? edge[1] : edge[2]);
        at.du = splat<F>(largest > 0.0f && largest < 1e6f ? 1.0f / largest : 1.0f);
        at.dv = at.du;
        at.cube_face = select(face_x, splat<I>(0), select(face_z, splat<I>(4), splat<I>(2))) + ((major < zero) & splat<I>(1));
        return at;
    }
    at.u = select(along_x, p.y, p.x);
    at.v = select(along_z, p.y, p.z);
    const F ex = splat<F>(edge[0] > 0.0f && edge[0] < 1e6f ? 1.0f / edge[0] : 1.0f);
    const F ey = splat<F>(edge[1] > 0.0f && edge[1] < 1e6f ? 1.0f / edge[1] : 1.0f);
    const F ez = splat<F>(edge[2] > 0.0f && edge[2] < 1e6f ? 1.0f / edge[2] : 1.0f);
    if (look.per_metre) {
        // MuJoCo's unit of length for this is 2 m.
        at.du = splat<F>(0.5f * look.repeat[0]);
        at.dv = splat<F>(0.5f * look.repeat[1]);
    } else {
        at.du = select(along_x, ey, ex) * look.repeat[0];
        at.dv = select(along_z, ey, ez) * look.repeat[1];
    }
    // The first image begins at the corner of least u and greatest v.
    const auto half = [&](int i) { return splat<F>(edge[i] < 1e6f ? 0.5f * edge[i] : 0.0f); };
    at.u = (at.u + select(along_x, half(1), half(0))) * at.du;
    at.v = (at.v - select(along_z, half(1), half(2))) * at.dv;
    return at;
}

HIL_INLINE Rgb texel_colour(const Texture &texture, const I &at) {
    const I packed = gather(texture.texel.data(), at);
    const auto channel = [&](int shift) {
        const F root = to_float(shift_right(packed, shift) & (std::int32_t)1023);
        return root * root * (1.0f / (1023.0f * 1023.0f));
    };
    return {channel(0), channel(10), channel(20)};
}

HIL_INLINE I clipped(const I &level, int levels) {
    const I zero = splat<I>(0), last = splat<I>(levels - 1);
    return select(level < zero, zero, select(level > last, last, level));
}

// Bilinear mean of four texels of a level.
HIL_INLINE Rgb bilinear(const Texture &texture, const TexturePlace &at, const F &u, const F &v, const I &level, const I &mask) {
    const I zero = splat<I>(0), one = splat<I>(1);
    const int face_height = texture.cube ? texture.width : texture.height;
    const I w = shift_right(splat<I>(texture.width), level), h = shift_right(splat<I>(face_height), level);
    const F x = u * to_float(w) - 0.5f, y = v * to_float(h) - 0.5f, x0 = floor(x), y0 = floor(y);
    const F across = x - x0, along = y - y0;
    const I power = splat<I>(__builtin_ctz((unsigned)texture.width)) - level;
    const I offset = look_up(texture.offset, level);
    I column[2], row[2];
    for (int k = 0; k < 2; ++k) {
        column[k] = truncate(x0 + 1.0f) + (std::int32_t)(k - 1);
        row[k] = truncate(y0 + 1.0f) + (std::int32_t)(k - 1);
        if (texture.cube) {
            column[k] = select(column[k] < zero, zero, select(column[k] >= w, w - one, column[k]));
            row[k] = select(row[k] < zero, zero, select(row[k] >= h, h - one, row[k]));
        } else {
            column[k] = column[k] & (w - one);
            row[k] = row[k] & (h - one);
        }
        row[k] = h - one - row[k];
        if (texture.cube) row[k] = row[k] + h * at.cube_face;
    }
    Rgb sum{splat<F>(0), splat<F>(0), splat<F>(0)};
    for (int k = 0; k < 4; ++k) {
        const F weight = (k & 1 ? across : 1.0f - across) * (k >> 1 ? along : 1.0f - along);
        const Rgb c = texel_colour(texture, select(mask, offset + texel_at(row[k >> 1], column[k & 1], power), zero));
        sum = {sum.r + weight * c.r, sum.g + weight * c.g, sum.b + weight * c.b};
    }
    return sum;
}

// Linear colour of a texture, without tint. `filtering`: trilinear (Williams, SIGGRAPH 1983), else the nearest texel of the
// nearest level.
HIL_INLINE Rgb sample(const Texture &texture, const TexturePlace &at, const Surface &s, float pixel_angle_rad, bool filtering) {
    const int width = texture.width, height = texture.cube ? texture.width : texture.height;
    // Level by the texels that one pixel covers: the finest level with at most about 1.5 along an edge.
    const F length = length_of(s.d), range = s.t * length;
    const F facing = max(abs(dot(s.normal, s.d)) * (1.0f / length), splat<F>(0.15f));
    const F covered = range * pixel_angle_rad * max(at.du * (float)width, at.dv * (float)height) / facing * 0.7f;
    // A mesh may have any texture coordinates; converting those out of the range of an int depends on the machine.
    const F u = select(abs(at.u) < splat<F>(1e6f), at.u - floor(at.u), splat<F>(0));
    const F v = select(abs(at.v) < splat<F>(1e6f), at.v - floor(at.v), splat<F>(0));
    const I one = splat<I>(1), zero = splat<I>(0);
    if (filtering) {
        // Level as a real number: the logarithm of twice the texels, linear between powers of two.
        // The geometric mean of a pixel's footprint along and across the slope, between blur and aliasing.
        const F texels = min(max(covered * (1.0f / 0.7f) * sqrt(facing), splat<F>(1)), splat<F>(65536));
        const I exponent = shift_right(as<I>(texels), 23) - (std::int32_t)127;
        const F between = as<F>((as<I>(texels) & (std::int32_t)0x7fffff) | (std::int32_t)0x3f800000) - 1.0f;
        const I fine = select(s.mask, clipped(exponent, texture.levels), zero), coarse = select(s.mask, clipped(exponent + one, texture.levels), zero);
        const Rgb a = bilinear(texture, at, u, v, fine, s.mask), b = bilinear(texture, at, u, v, coarse, s.mask);
        return {a.r + between * (b.r - a.r), a.g + between * (b.g - a.g), a.b + between * (b.b - a.b)};
    }
    I level = shift_right(as<I>(max(covered, splat<F>(1))), 23) - (std::int32_t)126;
    level = select(covered < splat<F>(1), splat<I>(0), level);
    level = select(level > splat<I>(texture.levels - 1), splat<I>(texture.levels - 1), level);
    const I w = shift_right(splat<I>(width), level), h = shift_right(splat<I>(height), level);
    const I column = truncate(u * to_float(w)) & (w - one);
    I row = h - one - (truncate(v * to_float(h)) & (h - one));
    if (texture.cube) row = row + h * at.cube_face;
    const I texel = look_up(texture.offset, select(s.mask, level, zero)) + texel_at(row, column, splat<I>(__builtin_ctz((unsigned)width)) - level);
    return texel_colour(texture, select(s.mask, texel, zero));
}

// Colour of the surface, linear.
HIL_INLINE Rgb albedo(const Appearance &look, const Rgb &texel) {
    return {texel.r * decode(look.rgb[0]), texel.g * decode(look.rgb[1]), texel.b * decode(look.rgb[2])};
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
