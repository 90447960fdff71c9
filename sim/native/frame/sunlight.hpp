// Sunlight on the pixels of a surface. For use in *.isa.cpp only.
#pragma once

#include "shapes.hpp"
#include "surface_colour.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

HIL_INLINE bool convex(Shape shape) { return shape != Shape::kMesh; }

// Mask of the points p from which a ray towards the sun (-z of the sun's camera) hits one triangle of a mesh; all in
// that camera's frame.
HIL_INLINE I meets_triangle(const DrawnGeom &g, std::int32_t triangle, const Vec<F> &p, float near) {
    const float *m = g.m;
    float v[3][3];
    for (int corner = 0; corner < 3; ++corner) {
        const float *from = g.mesh->vertex.data() + 3 * (long)g.mesh->triangle.data()[3 * (long)triangle + corner];
        const float q[3] = {from[0] - g.o[0], from[1] - g.o[1], from[2] - g.o[2]};
        for (int i = 0; i < 3; ++i) v[corner][i] = q[0] * m[i] + q[1] * m[3 + i] + q[2] * m[6 + i];
    }
    const auto side = [&](const float *a, const float *b) { return (p.x - a[0]) * (b[1] - a[1]) - (p.y - a[1]) * (b[0] - a[0]); };
    const F e0 = side(v[0], v[1]), e1 = side(v[1], v[2]), e2 = side(v[2], v[0]), zero = splat<F>(0);
    const I in = ((e0 >= zero) & (e1 >= zero) & (e2 >= zero)) | ((e0 <= zero) & (e1 <= zero) & (e2 <= zero));
    const float ab[3] = {v[1][0] - v[0][0], v[1][1] - v[0][1], v[1][2] - v[0][2]};
    const float ac[3] = {v[2][0] - v[0][0], v[2][1] - v[0][1], v[2][2] - v[0][2]};
    const float n[3] = {ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]};
    if (n[2] == 0.0f) return zero != zero;
    const F z = v[0][2] - ((p.x - v[0][0]) * n[0] + (p.y - v[0][1]) * n[1]) * (1.0f / n[2]);
    return in & (p.z - z > splat<F>(near));
}

// Mask of the points from which a ray towards the sun hits a primitive.
HIL_INLINE I meets(const DrawnGeom &g, const Vec<F> &p, float near) {
    const float *m = g.m;
    const Vec<F> o{g.o[0] + (p.x * m[0] + p.y * m[1] + p.z * m[2]), g.o[1] + (p.x * m[3] + p.y * m[4] + p.z * m[5]),
                   g.o[2] + (p.x * m[6] + p.y * m[7] + p.z * m[8])};
    const Vec<F> d{splat<F>(-m[2]), splat<F>(-m[5]), splat<F>(-m[8])};
    const F t_min = splat<F>(near), inf = splat<F>(LaneTraits<F>::kInf);
    switch (g.shape) {
        case Shape::kSphere: return ray_sphere(o, d, g.radius, t_min) < inf;
        case Shape::kBox: return ray_box(o, d, g.half, t_min) < inf;
        case Shape::kCapsule: return ray_capsule(o, d, g.radius, g.half[2], t_min) < inf;
        case Shape::kCylinder: return ray_cylinder(o, d, g.radius, g.half[2], t_min) < inf;
        case Shape::kEllipsoid: return ray_ellipsoid(o, d, t_min) < inf;
        default: return inf < inf;
    }
}

struct Caster {
    std::int32_t geom, triangle;  // triangle < 0: the whole geom
};

HIL_INLINE std::int32_t triangles_of(const DrawnGeom &g) { return (std::int32_t)(g.mesh->triangle.size() / 3); }

// True for a mesh whose triangles are smaller than the pixels of the shadow map: a pixel names one of many.
HIL_INLINE bool is_fine(const DrawnGeom &g, const ShadowMap &map) {
    return g.shape == Shape::kMesh && g.mesh->edge_m * map.rays->fx < 2.0f && triangles_of(g) > 32;
}

// Points of rays in the frame of the sun's camera.
HIL_INLINE Vec<F> in_sun(const ResolveJob &job, const Vec<F> &d, const F &t) {
    const float *m = job.camera_to_sun;
    const Vec<F> c{d.x * t, d.y * t, d.z * t};
    return {job.camera_in_sun[0] + (c.x * m[0] + c.y * m[1] + c.z * m[2]), job.camera_in_sun[1] + (c.x * m[3] + c.y * m[4] + c.z * m[5]),
            job.camera_in_sun[2] + (c.x * m[6] + c.y * m[7] + c.z * m[8])};
}

HIL_INLINE I pixel_of_map(const VisibilityBuffer &buffer, const I &x, const I &y) {
    return shift_left(shift_right(y, 2) * (std::int32_t)buffer.blocks_x + shift_right(x, 2), 4) + shift_left(y & 3, 2) + (x & 3);
}

// Fetches what `sunlight` will read of the shadow maps for the corners of a block.
HIL_INLINE void prefetch_shadows(const ResolveJob &job, const Vec<F> &d, const F &t) {
    const Vec<F> p = in_sun(job, d, t);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
        const I inside = (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) & (fx < splat<F>((float)map.x1)) &
                         (fy < splat<F>((float)map.y1));
        const unsigned lanes = bits(inside);
        if (lanes == 0) continue;
        std::int32_t at[16];
        store(at, pixel_of_map(*map.buffer, truncate(select(inside, fx, splat<F>(0))), truncate(select(inside, fy, splat<F>(0)))));
        for (const int corner : {0, 3, 12, 15}) {
            if (lanes >> corner & 1) __builtin_prefetch(map.buffer->t.data() + at[corner]);
        }
    }
}

// Returns the visible share of the sun: 0 or 1, except below soft casters. If the four pixels of the shadow map around a
// point name the same geom, and it is not the point's own mesh, they decide. Otherwise a ray from the point is
// intersected with the shapes and triangles that they name: the edge of a shadow is then as sharp as the shape, at any
// resolution of the map. Soft casters, meshes with holes (leaves) and meshes of small triangles (people), are too fine
// for that: their share is that of the four pixels, weighted bilinearly (Reeves et al., SIGGRAPH 1987).
HIL_NOINLINE F sunlight(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles, const I &wanted) {
    constexpr int kMost = 64;   // casters tested for one block
    constexpr float kFoliage = 0.15f;  // [m] least distance of a caster with holes, so that no leaf shades itself
    constexpr float kFine = 0.06f;      // [m] the same of a fine mesh: limbs overlap at their joints
    constexpr int kWhole = 32;  // greatest number of triangles of a mesh that is tested as a whole
    F light = splat<F>(1);
    const Vec<F> p = in_sun(job, s.d, s.t);
    const bool is_convex = convex(g.shape);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const VisibilityBuffer &buffer = *map.buffer;
        const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
        const I inside = wanted & (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) &
                         (fx < splat<F>((float)map.x1)) & (fy < splat<F>((float)map.y1));
        if (!any(inside)) continue;
        const I nowhere = splat<I>(0), column = select(inside, truncate(fx), nowhere), row = select(inside, truncate(fy), nowhere);
        const F limit = p.z - 0.02f;
        // Most points have no caster in any of the four pixels.
        I before = nowhere, taps[4];
        for (int tap = 0; tap < 4; ++tap) {
            const I tx = column + (tap & 1), ty = row + (tap >> 1);
            taps[tap] = pixel_of_map(buffer, tx, ty);
            before |= inside & (gather(buffer.t.data(), taps[tap]) < limit);
        }
        unsigned lanes = bits(before);
        if (lanes == 0) continue;
        std::int32_t places[4][16], blocked[16] = {};
        float z[16], right[16], down[16], dim[16] = {};
        store(right, fx - floor(fx));
        store(down, fy - floor(fy));
        for (int tap = 0; tap < 4; ++tap) store(places[tap], taps[tap]);
        store(z, limit);
        Caster casters[kMost];
        int count = 0;
        std::int32_t last = -1;  // caster seen last: mostly the next one too
        bool soft = false;
        float apart = 0.0f;
        unsigned doubtful = 0;
        for (; lanes != 0; lanes &= lanes - 1) {
            const int lane = __builtin_ctz(lanes);
            int hits = 0;
            bool own = false, one = true;
            Caster found[4];
            for (int tap = 0; tap < 4; ++tap) {
                const long at = places[tap][lane];
                if (!(buffer.t.data()[at] < z[lane])) continue;
                const std::int32_t caster = buffer.geom.data()[at];
                // A convex shape shades no point of itself that faces the sun.
                if (caster < 0 || (caster == g.geom && is_convex)) continue;
                if (caster != last) {
                    const DrawnGeom &drawn = map.drawn[map.drawn_of_geom[caster]];
                    last = caster;
                    soft = drawn.mask != nullptr || (caster != g.geom && is_fine(drawn, map));
                    apart = drawn.mask != nullptr ? kFoliage : kFine;
                }
                if (soft) {
                    const float across = tap & 1 ? right[lane] : 1.0f - right[lane];
                    const float along = tap >> 1 ? down[lane] : 1.0f - down[lane];
                    if (buffer.t.data()[at] < z[lane] - apart) dim[lane] += across * along;
                    continue;
                }
                own = own || caster == g.geom;
                found[hits++] = {caster, buffer.triangle.data()[at]};
                one = one && caster == found[0].geom;
            }
            if (hits == 4 && one && !own) {
                blocked[lane] = -1;
            } else if (hits > 0) {
                doubtful |= 1u << lane;
                for (int i = 0; i < hits && count < kMost; ++i) {
                    const DrawnGeom &caster = map.drawn[map.drawn_of_geom[found[i].geom]];
                    if (caster.shape != Shape::kMesh || triangles_of(caster) <= kWhole) found[i].triangle = -1;
                    bool known = false;
                    for (int j = 0; j < count; ++j) {
                        known = known || (casters[j].geom == found[i].geom && casters[j].triangle == found[i].triangle);
                    }
                    if (!known) casters[count++] = found[i];
                }
            }
        }
        I shade = load<I>(blocked);
        if (doubtful != 0) {
            std::int32_t open[16];
            for (int lane = 0; lane < 16; ++lane) open[lane] = doubtful >> lane & 1 ? -1 : 0;
            const I ask = load<I>(open), own_triangle = load<I>(triangles);
            for (int i = 0; i < count; ++i) {
                const DrawnGeom &caster = map.drawn[map.drawn_of_geom[casters[i].geom]];
                if (caster.shape != Shape::kMesh) {
                    shade |= ask & meets(caster, p, 1e-3f);
                    continue;
                }
                const bool whole = casters[i].triangle < 0;
                const std::int32_t from = whole ? 0 : casters[i].triangle, to = whole ? triangles_of(caster) : from + 1;
                for (std::int32_t t = from; t < to; ++t) {
                    I hit = ask & meets_triangle(caster, t, p, 1e-3f);
                    if (casters[i].geom == g.geom) hit &= own_triangle != splat<I>(t);
                    shade |= hit;
                }
            }
        }
        light = select(shade, splat<F>(0), light * (1.0f - load<F>(dim)));
    }
    return light;
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
