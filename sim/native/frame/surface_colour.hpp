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

HIL_INLINE Vec<F> local_point(const DrawnGeom &g, const Surface &s) {
    const float *m = g.m;
    return {g.o[0] + s.t * (s.d.x * m[0] + s.d.y * m[1] + s.d.z * m[2]), g.o[1] + s.t * (s.d.x * m[3] + s.d.y * m[4] + s.d.z * m[5]),
            g.o[2] + s.t * (s.d.x * m[6] + s.d.y * m[7] + s.d.z * m[8])};
}

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

// Edges of a geom's box in its own frame [m], for the placing of textures; of an infinite plane 0 or less, or 1e6 and more.
HIL_INLINE void edges_of(const DrawnGeom &g, float *edge) {
    const bool is_round = g.shape == Shape::kSphere || g.shape == Shape::kCapsule || g.shape == Shape::kCylinder;
    for (int i = 0; i < 3; ++i) {
        edge[i] = is_round && (i < 2 || g.shape == Shape::kSphere) ? 2.0f * g.radius : 2.0f * g.half[i];
        if (g.shape == Shape::kMesh) edge[i] = g.mesh->box.hi[i] - g.mesh->box.lo[i];
    }
}

HIL_INLINE float per_edge(float edge) { return edge > 0.0f && edge < 1e6f ? 1.0f / edge : 1.0f; }

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
    float edge[3];
    edges_of(g, edge);
    if (g.shape == Shape::kEllipsoid) p = {p.x * g.half[0], p.y * g.half[1], p.z * g.half[2]};
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
        at.du = splat<F>(per_edge(largest));
        at.dv = at.du;
        at.cube_face = select(face_x, splat<I>(0), select(face_z, splat<I>(4), splat<I>(2))) + ((major < zero) & splat<I>(1));
        return at;
    }
    at.u = select(along_x, p.y, p.x);
    at.v = select(along_z, p.y, p.z);
    if (look.per_metre) {
        // MuJoCo's unit of length for this is 2 m.
        at.du = splat<F>(0.5f * look.repeat[0]);
        at.dv = splat<F>(0.5f * look.repeat[1]);
    } else {
        at.du = select(along_x, splat<F>(per_edge(edge[1])), splat<F>(per_edge(edge[0]))) * look.repeat[0];
        at.dv = select(along_z, splat<F>(per_edge(edge[1])), splat<F>(per_edge(edge[2]))) * look.repeat[1];
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

// Position within one copy of a texture, 0 to 1. A mesh may have any texture coordinates; converting those out of the range
// of an int depends on the machine.
HIL_INLINE F within_copy(const F &u) { return select(abs(u) < splat<F>(1e6f), u - floor(u), splat<F>(0)); }

// Index of the nearest texel of the nearest level for a pixel that covers `covered` / 0.7 texels of level 0.
HIL_INLINE I nearest_texel(const Texture &texture, const F &u, const F &v, const F &covered, const I &cube_face, const I &mask) {
    const I zero = splat<I>(0);
    const int face_height = texture.cube ? texture.width : texture.height;
    I level = shift_right(as<I>(max(covered, splat<F>(1))), 23) - (std::int32_t)126;
    level = select(covered < splat<F>(1), zero, level);
    level = select(level > splat<I>(texture.levels - 1), splat<I>(texture.levels - 1), level);
    const I w = shift_right(splat<I>(texture.width), level), h = shift_right(splat<I>(face_height), level), one = splat<I>(1);
    const I column = truncate(u * to_float(w)) & (w - one);
    I row = h - one - (truncate(v * to_float(h)) & (h - one));
    if (texture.cube) row = row + h * cube_face;
    const I power = splat<I>(__builtin_ctz((unsigned)texture.width)) - level;
    return select(mask, look_up(texture.offset, select(mask, level, zero)) + texel_at(row, column, power), zero);
}

// Cosine between the normal and the ray, at least 0.15, and the texels of the finest level that one pixel covers, times 0.7.
struct Footprint {
    F facing, covered;
};

HIL_INLINE Footprint footprint(const Texture &texture, const TexturePlace &at, const Surface &s, float pixel_angle_rad) {
    const int width = texture.width, height = texture.cube ? texture.width : texture.height;
    const F length = length_of(s.d), range = s.t * length;
    const F facing = max(abs(dot(s.normal, s.d)) * (1.0f / length), splat<F>(0.15f));
    return {facing, range * pixel_angle_rad * max(at.du * (float)width, at.dv * (float)height) / facing * 0.7f};
}

HIL_INLINE I nearest_texel(const Texture &texture, const TexturePlace &at, const Surface &s, float pixel_angle_rad) {
    const F covered = footprint(texture, at, s, pixel_angle_rad).covered;
    return nearest_texel(texture, within_copy(at.u), within_copy(at.v), covered, at.cube_face, s.mask);
}

// Linear colour of a texture, without tint. `filtering`: trilinear (Williams, SIGGRAPH 1983), else the nearest texel of the
// nearest level.
HIL_INLINE Rgb sample(const Texture &texture, const TexturePlace &at, const Surface &s, float pixel_angle_rad, bool filtering) {
    if (!filtering) return texel_colour(texture, nearest_texel(texture, at, s, pixel_angle_rad));
    const Footprint pixel = footprint(texture, at, s, pixel_angle_rad);
    const F u = within_copy(at.u), v = within_copy(at.v);
    const I one = splat<I>(1), zero = splat<I>(0);
    // Level as a real number: the logarithm of twice the texels, linear between powers of two.
    // The geometric mean of a pixel's footprint along and across the slope, between blur and aliasing.
    const F texels = min(max(pixel.covered * (1.0f / 0.7f) * sqrt(pixel.facing), splat<F>(1)), splat<F>(65536));
    const I exponent = shift_right(as<I>(texels), 23) - (std::int32_t)127;
    const F between = as<F>((as<I>(texels) & (std::int32_t)0x7fffff) | (std::int32_t)0x3f800000) - 1.0f;
    const I fine = select(s.mask, clipped(exponent, texture.levels), zero), coarse = select(s.mask, clipped(exponent + one, texture.levels), zero);
    const Rgb a = bilinear(texture, at, u, v, fine, s.mask), b = bilinear(texture, at, u, v, coarse, s.mask);
    return {a.r + between * (b.r - a.r), a.g + between * (b.g - a.g), a.b + between * (b.b - a.b)};
}

// Blocks resolved together. Their texels are read last, all at once: from the nearest level they are mostly not in a cache.
constexpr int kRun = 16, kPatches = 48;
struct Patch {  // pixels of one block that show one texture
    const Texture *texture;
    int at;  // block of the run
    I mask, texel;
    Rgb light;
};
// Points of a block in the pictures that the sun sees (ShadowMap), for the lanes that see anything.
struct SunPlace {
    Vec<F> p;         // in the frame of the sun's camera
    bool some[2];     // the map has something for a lane
    I column[2], row[2], sole[2];  // pixel, and ShadowMap::sole there; -1 outside the map
};
struct Run {
    SunPlace sun[kRun];
    Rgb colour[kRun];
    Patch patch[kPatches];
    int patches = 0;
};

HIL_INLINE void put_now(Run &run, int at, const I &mask, const Rgb &c) {
    Rgb &to = run.colour[at];
    to = {select(mask, c.r, to.r), select(mask, c.g, to.g), select(mask, c.b, to.b)};
}

HIL_INLINE void put_texels(Run &run) {
    for (int i = 0; i < run.patches; ++i) {
        const Patch &p = run.patch[i];
        const Rgb c = texel_colour(*p.texture, p.texel);
        put_now(run, p.at, p.mask, {c.r * p.light.r, c.g * p.light.g, c.b * p.light.b});
    }
    run.patches = 0;
}

// The colour of texels times `light`.
HIL_INLINE void put_later(Run &run, int at, const I &mask, const Texture &texture, const I &texel, const Rgb &light) {
    if (run.patches == kPatches) put_texels(run);
    Patch &p = run.patch[run.patches++];
    p = {&texture, at, mask, texel, light};
    std::int32_t index[16];
    store(index, texel);
    // A cache line is a square of 4 x 4 texels: those of the corners are most of a block's.
    for (const int corner : {0, 3, 12, 15}) __builtin_prefetch(texture.texel.data() + index[corner]);
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
