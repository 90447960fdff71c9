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

// ShadowMap::sole at these pixels.
HIL_INLINE I sole_at(const ShadowMap &map, const I &column, const I &row) {
    constexpr int kShift = __builtin_ctz(kArea);
    return gather(map.sole, shift_right(row, kShift) * map.areas_x + shift_right(column, kShift));
}

// Fetches what `sunlight` will read of the shadow maps for the corners of a block.
HIL_INLINE void prefetch_shadows(const ResolveJob &job, const Vec<F> &d, const F &t) {
    const Vec<F> p = in_sun(job, d, t);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
        const I inside = (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) & (fx < splat<F>((float)map.x1)) &
                         (fy < splat<F>((float)map.y1));
        if (!any(inside)) continue;
        const I column = truncate(select(inside, fx, splat<F>(0))), row = truncate(select(inside, fy, splat<F>(0)));
        const unsigned lanes = bits(inside & (sole_at(map, column, row) != splat<I>(-1)));
        if (lanes == 0) continue;
        std::int32_t at[16];
        store(at, pixel_of_map(*map.buffer, column, row));
        for (const int corner : {0, 3, 12, 15}) {
            if (!(lanes >> corner & 1)) continue;
            __builtin_prefetch(map.buffer->t.data() + at[corner]);
            __builtin_prefetch(map.buffer->geom.data() + at[corner]);
        }
    }
}

constexpr int kTaps = 4;  // pixels of a shadow map around a point

// Calls f(number, here) for each of the numbers in the lanes `in`; here[tap]: the lanes of `in[tap]` with this number.
template <class Function>
HIL_INLINE void each_number(const I *number, const I *in, Function &&f) {
    std::int32_t lane[kTaps][16];
    I left[kTaps], here[kTaps];
    for (int tap = 0; tap < kTaps; ++tap) {
        store(lane[tap], number[tap]);
        left[tap] = in[tap];
    }
    for (int first = 0; first < kTaps; ++first) {
        for (unsigned lanes = bits(left[first]); lanes != 0;) {
            const std::int32_t one = lane[first][__builtin_ctz(lanes)];
            for (int tap = 0; tap < kTaps; ++tap) {
                here[tap] = left[tap] & (number[tap] == splat<I>(one));
                left[tap] &= ~here[tap];
            }
            lanes &= ~bits(here[first]);
            f(one, here);
        }
    }
}

// Returns the visible share of the sun: 0 or 1, except below soft casters. If the four pixels of the shadow map around a
// point name the same geom, and it is not the point's own mesh, they decide. Otherwise a ray from the point is
// intersected with the shapes and triangles that they name: the edge of a shadow is then as sharp as the shape, at any
// resolution of the map. Soft casters, meshes with holes (leaves) and meshes of small triangles (people), are too fine
// for that: their share is that of the four pixels, weighted bilinearly (Reeves et al., SIGGRAPH 1987).
HIL_NOINLINE F sunlight(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles, const I &wanted) {
    constexpr float kFoliage = 0.15f;  // [m] least distance of a caster with holes, so that no leaf shades itself
    constexpr float kFine = 0.06f;      // [m] the same of a fine mesh: limbs overlap at their joints
    constexpr int kWhole = 32;  // greatest number of triangles of a mesh that is tested as a whole
    F light = splat<F>(1);
    const Vec<F> p = in_sun(job, s.d, s.t);
    const I nowhere = splat<I>(0), own = splat<I>(g.geom);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const VisibilityBuffer &buffer = *map.buffer;
        const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
        I inside = wanted & (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) &
                         (fx < splat<F>((float)map.x1)) & (fy < splat<F>((float)map.y1));
        if (!any(inside)) continue;
        const I column = select(inside, truncate(fx), nowhere), row = select(inside, truncate(fy), nowhere);
        // A convex shape shades no point of itself that faces the sun.
        const I sole = sole_at(map, column, row);
        inside &= (sole != splat<I>(-1)) & (sole != splat<I>(convex(g.shape) ? g.geom : -1));
        if (!any(inside)) continue;
        const F limit = p.z - 0.02f;
        I at[kTaps], geom[kTaps], casts[kTaps], before = nowhere;
        F t[kTaps];
        for (int tap = 0; tap < kTaps; ++tap) {
            at[tap] = pixel_of_map(buffer, column + (tap & 1), row + (tap >> 1));
            t[tap] = gather(buffer.t.data(), at[tap]);
            casts[tap] = inside & (t[tap] < limit);
            before |= casts[tap];
        }
        // Most points have no caster in any of the four pixels.
        if (!any(before)) continue;
        const bool several = any(inside & (sole == splat<I>(kSeveral)));
        for (int tap = 0; tap < kTaps; ++tap) {
            geom[tap] = several ? gather(buffer.geom.data(), at[tap]) : sole;
            casts[tap] &= geom[tap] >= nowhere;
            if (convex(g.shape)) casts[tap] &= geom[tap] != own;
        }
        const F right = fx - floor(fx), down = fy - floor(fy);
        F dim[kTaps] = {splat<F>(0), splat<F>(0), splat<F>(0), splat<F>(0)};
        each_number(geom, casts, [&](std::int32_t number, const I *here) {
            const DrawnGeom &caster = map.drawn[map.drawn_of_geom[number]];
            if (caster.mask == nullptr && (number == g.geom || !is_fine(caster, map))) return;
            const F soft_limit = limit - (caster.mask != nullptr ? kFoliage : kFine);
            for (int tap = 0; tap < kTaps; ++tap) {
                const F weight = (tap & 1 ? right : 1.0f - right) * (tap >> 1 ? down : 1.0f - down);
                dim[tap] = select(here[tap] & (t[tap] < soft_limit), weight, dim[tap]);
                casts[tap] &= ~here[tap];
            }
        });
        I shade = casts[0] & casts[1] & casts[2] & casts[3];
        shade &= (geom[0] == geom[1]) & (geom[0] == geom[2]) & (geom[0] == geom[3]) & (geom[0] != own);
        const I doubtful = (casts[0] | casts[1] | casts[2] | casts[3]) & ~shade;
        if (any(doubtful)) {
            for (I &some : casts) some &= doubtful;
            const I own_triangle = load<I>(triangles);
            each_number(geom, casts, [&](std::int32_t number, const I *here) {
                const DrawnGeom &caster = map.drawn[map.drawn_of_geom[number]];
                if (caster.shape != Shape::kMesh) {
                    shade |= doubtful & meets(caster, p, 1e-3f);
                    return;
                }
                const auto meet = [&](std::int32_t triangle) {
                    I hit = doubtful & meets_triangle(caster, triangle, p, 1e-3f);
                    if (number == g.geom) hit &= own_triangle != splat<I>(triangle);
                    shade |= hit;
                };
                const std::int32_t count = triangles_of(caster);
                if (count <= kWhole) {
                    for (std::int32_t i = 0; i < count; ++i) meet(i);
                    return;
                }
                I part[kTaps];
                for (int tap = 0; tap < kTaps; ++tap) part[tap] = gather(buffer.triangle.data(), at[tap]);
                each_number(part, here, [&](std::int32_t triangle, const I *) { meet(triangle); });
            });
        }
        light = select(shade, splat<F>(0), light * (1.0f - (dim[0] + dim[1] + dim[2] + dim[3])));
    }
    return light;
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
