// Intersection of rays with each primitive, in lanes: p(t) = o + t d in the shape's frame, d of any length > 0.
//
// Every function returns the nearest t >= t_min at which the ray meets the surface, +inf without a hit. From within a
// shape, that is where the ray leaves it, as in mj_ray. Sizes are MuJoCo's: radius, half lengths along z.
//
// Precision: a quadratic solved as b^2 - 4ac loses twice the digits of the distance. Here the ray's nearest point to
// the axis or centre is computed first,
//
//     t0 = -(o.d)/(d.d),   p = o + t0 d,   h^2 = r^2 - p.p,   t = t0 -+ sqrt(h^2 / d.d)
//
// so that the error of t is that of p, a few units in the last place of the distance (4e-6 m at 60 m in float),
// divided by the cosine of incidence (Haines et al., Ray Tracing Gems, ch. 7, 2019).
//
// The solids are convex: a ray is inside over one interval. The interval of a cylinder or a box is the intersection of
// the intervals of its slabs (Kay and Kajiya, SIGGRAPH 1986).
#pragma once

#include "lane_memory.hpp"

namespace hil::sim::frame::HIL_ISA {

// Interval [enter, leave] of t within a convex solid; empty if enter > leave.
template <class V>
struct Interval {
    V enter, leave;
};

template <class V>
HIL_INLINE V nearest(const Interval<V> &in, V t_min) {
    const V t = select(in.enter >= t_min, in.enter, in.leave);
    return select((in.enter <= in.leave) & (t >= t_min), t, splat<V>(LaneTraits<V>::kInf));
}

template <class V>
HIL_INLINE Interval<V> slab(V o, V d, ScalarOf<V> half) {
    const V tiny = splat<V>(LaneTraits<V>::kTiny);
    d = select(abs(d) < tiny, copysign(tiny, d), d);
    const V inverse = ScalarOf<V>(1) / d;
    const V a = (-half - o) * inverse, b = (half - o) * inverse;
    return {min(a, b), max(a, b)};
}

template <class V>
HIL_INLINE Interval<V> both(const Interval<V> &a, const Interval<V> &b) {
    return {max(a.enter, b.enter), min(a.leave, b.leave)};
}

template <class V>
HIL_INLINE Interval<V> from_nearest_point(V t0, V h2, V dd) {
    const V inf = splat<V>(LaneTraits<V>::kInf), zero = splat<V>(0);
    const V s = sqrt(max(h2, zero) / dd);
    const auto hit = h2 >= zero;
    return {select(hit, t0 - s, inf), select(hit, t0 + s, -inf)};
}

template <class V>
HIL_INLINE Interval<V> within_sphere(const Vec<V> &o, const Vec<V> &d, ScalarOf<V> radius) {
    const V dd = max(dot(d, d), splat<V>(LaneTraits<V>::kTiny2));
    const V t0 = -dot(o, d) / dd;
    const Vec<V> p{o.x + t0 * d.x, o.y + t0 * d.y, o.z + t0 * d.z};
    return from_nearest_point<V>(t0, radius * radius - dot(p, p), dd);
}

// Interval within the infinite cylinder around z.
template <class V>
HIL_INLINE Interval<V> within_tube(const Vec<V> &o, const Vec<V> &d, ScalarOf<V> radius) {
    const V dd = max(d.x * d.x + d.y * d.y, splat<V>(LaneTraits<V>::kTiny2));
    const V t0 = -(o.x * d.x + o.y * d.y) / dd;
    const V px = o.x + t0 * d.x, py = o.y + t0 * d.y;
    return from_nearest_point<V>(t0, radius * radius - (px * px + py * py), dd);
}

template <class V>
HIL_INLINE V ray_sphere(const Vec<V> &o, const Vec<V> &d, ScalarOf<V> radius, V t_min) {
    return nearest(within_sphere(o, d, radius), t_min);
}

template <class V>
HIL_INLINE V ray_box(const Vec<V> &o, const Vec<V> &d, const ScalarOf<V> *half, V t_min) {
    return nearest(both(both(slab(o.x, d.x, half[0]), slab(o.y, d.y, half[1])), slab(o.z, d.z, half[2])), t_min);
}

template <class V>
HIL_INLINE V ray_cylinder(const Vec<V> &o, const Vec<V> &d, ScalarOf<V> radius, ScalarOf<V> half, V t_min) {
    return nearest(both(within_tube(o, d, radius), slab(o.z, d.z, half)), t_min);
}

// A ray that enters the tube beyond an end can enter the capsule only through the sphere at that end; likewise leaving.
template <class V>
HIL_INLINE V ray_capsule(const Vec<V> &o, const Vec<V> &d, ScalarOf<V> radius, ScalarOf<V> half, V t_min) {
    const V inf = splat<V>(LaneTraits<V>::kInf), end = splat<V>(half);
    Interval<V> in = within_tube(o, d, radius);
    const auto tube = in.enter <= in.leave;
    const V z_in = o.z + in.enter * d.z, z_out = o.z + in.leave * d.z;
    const auto cap_in = tube & (abs(z_in) > end), cap_out = tube & (abs(z_out) > end);
    if (any(cap_in)) {
        const Vec<V> from_end{o.x, o.y, o.z - copysign(end, z_in)};
        in.enter = select(cap_in, within_sphere(from_end, d, radius).enter, in.enter);
    }
    if (any(cap_out)) {
        const Vec<V> from_end{o.x, o.y, o.z - copysign(end, z_out)};
        in.leave = select(cap_out, within_sphere(from_end, d, radius).leave, in.leave);
    }
    in.enter = select(tube, in.enter, inf);
    return nearest(in, t_min);
}

// o and d are divided by the semi-axes, so the shape is the unit sphere.
template <class V>
HIL_INLINE V ray_ellipsoid(const Vec<V> &o, const Vec<V> &d, V t_min) {
    return nearest(within_sphere(o, d, ScalarOf<V>(1)), t_min);
}

// Plane z = 0, hit from above only; half[0], half[1] <= 0: infinite.
template <class V>
HIL_INLINE V ray_plane(const Vec<V> &o, const Vec<V> &d, const ScalarOf<V> *half, V t_min) {
    const V inf = splat<V>(LaneTraits<V>::kInf), zero = splat<V>(0);
    const auto facing = d.z < -splat<V>(LaneTraits<V>::kTiny);
    const V t = -o.z / select(facing, d.z, splat<V>(ScalarOf<V>(-1)));
    auto hit = facing & (o.z >= zero) & (t >= t_min);
    if (half[0] > 0) hit &= abs(o.x + t * d.x) <= splat<V>(half[0]);
    if (half[1] > 0) hit &= abs(o.y + t * d.y) <= splat<V>(half[1]);
    return select(hit, t, inf);
}

// Triangle a b c given relative to the ray's origin (v = vertex - o), from either side. The edge functions are
//     e0 = (vb x vc) . d,  e1 = (vc x va) . d,  e2 = (va x vb) . d,   t = va . n / (e0 + e1 + e2),  n = (b-a) x (c-a)
// and at an edge that two triangles share, a ray gets exactly opposite values in both, so there are no cracks.
template <class V>
struct Triangle {
    Vec<V> e0, e1, e2, n;
    V volume;  // va . n
};
template <class V>
HIL_INLINE Vec<V> cross(const Vec<V> &a, const Vec<V> &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class V>
HIL_INLINE Vec<V> triangle_normal(const Vec<V> &va, const Vec<V> &vb, const Vec<V> &vc) {
    const Vec<V> ab{vb.x - va.x, vb.y - va.y, vb.z - va.z}, ac{vc.x - va.x, vc.y - va.y, vc.z - va.z};
    return cross(ab, ac);
}
template <class V>
HIL_INLINE Triangle<V> triangle(const Vec<V> &va, const Vec<V> &vb, const Vec<V> &vc) {
    Triangle<V> r{cross(vb, vc), cross(vc, va), cross(va, vb), triangle_normal(va, vb, vc), {}};
    r.volume = dot(va, r.n);
    return r;
}
// Most triangles are hit by no ray: their normals are then not computed.
template <class V>
HIL_INLINE V ray_triangle(const Vec<V> &va, const Vec<V> &vb, const Vec<V> &vc, const Vec<V> &d, V t_min) {
    const V e0 = dot(cross(vb, vc), d), e1 = dot(cross(vc, va), d), e2 = dot(cross(va, vb), d);
    const V zero = splat<V>(0), inf = splat<V>(LaneTraits<V>::kInf);
    const auto in = ((e0 >= zero) & (e1 >= zero) & (e2 >= zero)) | ((e0 <= zero) & (e1 <= zero) & (e2 <= zero));
    if (!any(in)) return inf;
    const Vec<V> n = triangle_normal(va, vb, vc);
    const V slope = dot(n, d);
    const V at = dot(va, n) / slope;
    return select(in & (slope != zero) & (at >= t_min), at, inf);
}

}  // namespace hil::sim::frame::HIL_ISA
