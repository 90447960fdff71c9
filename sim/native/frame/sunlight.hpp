// Sunlight on the pixels of a surface. For use in *.isa.cpp only.
#pragma once

#include "shapes.hpp"
#include "surface_colour.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

HIL_INLINE bool convex(Shape shape) { return shape != Shape::kMesh; }

// One triangle of a mesh in the frame of the sun's camera.
struct SunTriangle {
    std::int32_t geom = -1, triangle = -1;
    bool edge_on = false;
    float x[3], y[3], along_x[3], along_y[3];  // corners, and edges from each to the next
    float z, normal_x, normal_y, per_normal_z;
};

// Neighbouring points ask for the same triangles. The table does not change the light: an entry depends on the geom, the
// triangle and the sun alone.
struct SunTriangles {
    static constexpr unsigned kEntries = 128;
    SunTriangle entry[kEntries];
};

HIL_INLINE const SunTriangle &triangle_in_sun(const DrawnGeom &g, std::int32_t triangle, SunTriangles &known) {
    SunTriangle &to = known.entry[((unsigned)g.geom * 37u + (unsigned)triangle) % SunTriangles::kEntries];
    if (to.geom == g.geom && to.triangle == triangle) return to;
    to.geom = g.geom;
    to.triangle = triangle;
    const float *m = g.m;
    float v[3][3];
    for (int corner = 0; corner < 3; ++corner) {
        const float *from = g.mesh->vertex.data() + 3 * (long)g.mesh->triangle.data()[3 * (long)triangle + corner];
        const float q[3] = {from[0] - g.o[0], from[1] - g.o[1], from[2] - g.o[2]};
        for (int i = 0; i < 3; ++i) v[corner][i] = q[0] * m[i] + q[1] * m[3 + i] + q[2] * m[6 + i];
    }
    for (int i = 0; i < 3; ++i) {
        const float *a = v[i], *b = v[(i + 1) % 3];
        to.x[i] = a[0];
        to.y[i] = a[1];
        to.along_x[i] = b[0] - a[0];
        to.along_y[i] = b[1] - a[1];
    }
    const float ab[3] = {v[1][0] - v[0][0], v[1][1] - v[0][1], v[1][2] - v[0][2]};
    const float ac[3] = {v[2][0] - v[0][0], v[2][1] - v[0][1], v[2][2] - v[0][2]};
    const float n[3] = {ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]};
    to.z = v[0][2];
    to.normal_x = n[0];
    to.normal_y = n[1];
    to.edge_on = n[2] == 0.0f;
    to.per_normal_z = 1.0f / n[2];
    return to;
}

// Mask of the points p from which a ray towards the sun (-z of the sun's camera) hits a triangle; all in that camera's frame.
HIL_INLINE I meets_triangle(const SunTriangle &a, const Vec<F> &p, float near) {
    const F zero = splat<F>(0);
    if (a.edge_on) return zero != zero;
    const auto side = [&](int i) { return (p.x - a.x[i]) * a.along_y[i] - (p.y - a.y[i]) * a.along_x[i]; };
    const F e0 = side(0), e1 = side(1), e2 = side(2);
    const I in = ((e0 >= zero) & (e1 >= zero) & (e2 >= zero)) | ((e0 <= zero) & (e1 <= zero) & (e2 <= zero));
    const F z = a.z - ((p.x - a.x[0]) * a.normal_x + (p.y - a.y[0]) * a.normal_y) * a.per_normal_z;
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

HIL_INLINE I pixel_of_map(const VisibilityBuffer &buffer, const I &x, const I &y) {
    return shift_left(shift_right(y, 2) * (std::int32_t)buffer.blocks_x + shift_right(x, 2), 4) + shift_left(y & 3, 2) + (x & 3);
}

// Finds where the points of a block lie in the sun's pictures, and fetches what `sunlight` will read for its corners.
HIL_INLINE void place_in_sun(const ResolveJob &job, const Vec<F> &d, const F &t, SunPlace &to) {
    const float *m = job.camera_to_sun;
    const Vec<F> c{d.x * t, d.y * t, d.z * t};
    to.p = {job.camera_in_sun[0] + (c.x * m[0] + c.y * m[1] + c.z * m[2]), job.camera_in_sun[1] + (c.x * m[3] + c.y * m[4] + c.z * m[5]),
            job.camera_in_sun[2] + (c.x * m[6] + c.y * m[7] + c.z * m[8])};
    const I nowhere = splat<I>(0), none = splat<I>(-1);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const F fx = to.p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = to.p.y * map.rays->fy + (map.rays->cy - 0.5f);
        const I inside = (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) & (fx < splat<F>((float)map.x1)) &
                         (fy < splat<F>((float)map.y1));
        to.some[k] = any(inside);
        if (!to.some[k]) continue;
        const I column = select(inside, truncate(fx), nowhere), row = select(inside, truncate(fy), nowhere);
        const I sole = select(inside, gather(map.sole, shift_right(row, map.area_power) * map.areas_x + shift_right(column, map.area_power)), none);
        const unsigned lanes = bits(sole != none);
        to.some[k] = lanes != 0;
        if (lanes == 0) continue;
        to.column[k] = column;
        to.row[k] = row;
        to.sole[k] = sole;
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

// Calls f(number, here) for each of the numbers in the lanes `in`; here[tap]: the lanes of `in[tap]` with this number. Lanes as
// in `bits`.
template <class Function>
HIL_INLINE void each_number(const I *number, const unsigned *in, Function &&f) {
    unsigned left[kTaps], here[kTaps];
    for (int tap = 0; tap < kTaps; ++tap) left[tap] = in[tap];
    for (int first = 0; first < kTaps; ++first) {
        if (left[first] == 0) continue;
        std::int32_t lane[16];
        store(lane, number[first]);
        while (left[first] != 0) {
            const std::int32_t one = lane[__builtin_ctz(left[first])];
            const I same = splat<I>(one);
            for (int tap = 0; tap < kTaps; ++tap) {
                here[tap] = left[tap] == 0 ? 0 : left[tap] & bits(number[tap] == same);
                left[tap] &= ~here[tap];
            }
            f(one, here);
        }
    }
}

// Returns the visible share of the sun: 0 or 1, except below soft casters. If the four pixels of the shadow map around a
// point name the same geom, and it is not the point's own mesh, they decide. Otherwise a ray from the point is
// intersected with the shapes and triangles that they name: the edge of a shadow is then as sharp as the shape, at any
// resolution of the map. Soft casters, meshes with holes (leaves) and meshes of small triangles (people), are too fine
// for that: their share is that of the four pixels, weighted bilinearly (Reeves et al., SIGGRAPH 1987).
HIL_NOINLINE F sunlight(const ResolveJob &job, const DrawnGeom &g, const SunPlace &place, const std::int32_t *triangles, const I &wanted,
                        SunTriangles &known) {
    constexpr float kFoliage = 0.15f;  // [m] least distance of a caster with holes, so that no leaf shades itself
    constexpr float kFine = 0.06f;      // [m] the same of a fine mesh: limbs overlap at their joints
    constexpr int kWhole = 32;  // greatest number of triangles of a mesh that is tested as a whole
    F light = splat<F>(1);
    const Vec<F> &p = place.p;
    const I own = splat<I>(g.geom);
    for (int k = 0; k < job.shadows; ++k) {
        if (!place.some[k]) continue;
        const ShadowMap &map = job.shadow[k];
        const VisibilityBuffer &buffer = *map.buffer;
        // A convex shape shades no point of itself that faces the sun.
        const I &sole = place.sole[k];
        const unsigned inside = bits(wanted & (sole != splat<I>(-1)) & (sole != splat<I>(convex(g.shape) ? g.geom : -1)));
        if (inside == 0) continue;
        const F limit = p.z - 0.02f;
        const I &column = place.column[k], &row = place.row[k];
        const auto across = [](const I &x) { return shift_left(shift_right(x, 2), 4) + (x & 3); };
        const auto down_by = [&](const I &y) { return shift_left(shift_right(y, 2) * (std::int32_t)buffer.blocks_x, 4) + shift_left(y & 3, 2); };
        const I x[2] = {across(column), across(column + (std::int32_t)1)}, y[2] = {down_by(row), down_by(row + (std::int32_t)1)};
        I at[kTaps], geom[kTaps];
        unsigned casts[kTaps], before = 0;
        F t[kTaps];
        for (int tap = 0; tap < kTaps; ++tap) {
            at[tap] = y[tap >> 1] + x[tap & 1];
            t[tap] = gather(buffer.t.data(), at[tap]);
            casts[tap] = inside & bits(t[tap] < limit);
            before |= casts[tap];
        }
        if (before == 0) continue;
        const bool several = (inside & bits(sole == splat<I>(kSeveral))) != 0;
        unsigned some = 0;
        for (int tap = 0; tap < kTaps; ++tap) {
            geom[tap] = several ? gather(buffer.geom.data(), at[tap]) : sole;
            casts[tap] &= bits(geom[tap] >= splat<I>(0));
            if (convex(g.shape)) casts[tap] &= bits(geom[tap] != own);
            some |= casts[tap];
        }
        // Most points have no caster in any of the four pixels.
        if (some == 0) continue;
        F dim[kTaps] = {splat<F>(0), splat<F>(0), splat<F>(0), splat<F>(0)};
        each_number(geom, casts, [&](std::int32_t number, const unsigned *here) {
            const DrawnGeom &caster = map.drawn[map.drawn_of_geom[number]];
            if (caster.mask == nullptr && (number == g.geom || !is_fine(caster, map))) return;
            const F soft_limit = limit - (caster.mask != nullptr ? kFoliage : kFine);
            const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
            const F right = fx - floor(fx), down = fy - floor(fy);
            for (int tap = 0; tap < kTaps; ++tap) {
                const F weight = (tap & 1 ? right : 1.0f - right) * (tap >> 1 ? down : 1.0f - down);
                dim[tap] = select(lanes_of(here[tap]) & (t[tap] < soft_limit), weight, dim[tap]);
                casts[tap] &= ~here[tap];
            }
        });
        unsigned shade = casts[0] & casts[1] & casts[2] & casts[3];
        if (shade != 0) shade &= bits((geom[0] == geom[1]) & (geom[0] == geom[2]) & (geom[0] == geom[3]) & (geom[0] != own));
        const unsigned doubtful = (casts[0] | casts[1] | casts[2] | casts[3]) & ~shade;
        if (doubtful != 0) {
            for (unsigned &some_casts : casts) some_casts &= doubtful;
            const I own_triangle = load<I>(triangles);
            each_number(geom, casts, [&](std::int32_t number, const unsigned *here) {
                const DrawnGeom &caster = map.drawn[map.drawn_of_geom[number]];
                if (caster.shape != Shape::kMesh) {
                    shade |= doubtful & bits(meets(caster, p, 1e-3f));
                    return;
                }
                const auto meet = [&](std::int32_t triangle) {
                    unsigned hit = doubtful & bits(meets_triangle(triangle_in_sun(caster, triangle, known), p, 1e-3f));
                    if (number == g.geom) hit &= bits(own_triangle != splat<I>(triangle));
                    shade |= hit;
                };
                const std::int32_t count = triangles_of(caster);
                if (count <= kWhole) {
                    for (std::int32_t i = 0; i < count; ++i) meet(i);
                    return;
                }
                I part[kTaps];
                for (int tap = 0; tap < kTaps; ++tap) part[tap] = gather(buffer.triangle.data(), at[tap]);
                each_number(part, here, [&](std::int32_t triangle, const unsigned *) { meet(triangle); });
            });
        }
        light = select(lanes_of(shade), splat<F>(0), light * (1.0f - (dim[0] + dim[1] + dim[2] + dim[3])));
    }
    return light;
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
