// Unit normals at the hits of eight rays, each turned against its ray. Included in ray_cast.isa.cpp only.
#pragma once

#include "lane_memory.hpp"
#include "ray_cast.hpp"

namespace hil::sim::frame::HIL_ISA {

// Outward normal, of any length, at the points q of a solid's surface, in its own frame.
HIL_INLINE Vec<D> solid_normal(const CastGeom &g, const Vec<D> &q) {
    const double *s = g.size;
    const D zero = splat<D>(0.0);
    switch (g.shape) {
        case Shape::kSphere: return q;
        case Shape::kCapsule: {
            const D top = splat<D>(s[1]);
            return {q.x, q.y, select(q.z > top, q.z - top, select(q.z < -top, q.z + top, zero))};
        }
        case Shape::kEllipsoid: return {q.x / splat<D>(s[0] * s[0]), q.y / splat<D>(s[1] * s[1]), q.z / splat<D>(s[2] * s[2])};
        case Shape::kCylinder: {
            // The nearer surface, side or end.
            const auto end = abs(abs(q.z) - s[1]) < abs(sqrt(q.x * q.x + q.y * q.y) - s[0]);
            return {select(end, zero, q.x), select(end, zero, q.y), select(end, q.z, zero)};
        }
        case Shape::kBox: {
            // The nearest face; the first of equally near ones.
            const D x = abs(abs(q.x) - s[0]), y = abs(abs(q.y) - s[1]), z = abs(abs(q.z) - s[2]);
            const auto past_x = y < x, is_z = z < select(past_x, y, x);
            return {select(past_x | is_z, zero, q.x), select(past_x & ~is_z, q.y, zero), select(is_z, q.z, zero)};
        }
        default: return {zero, zero, splat<D>(1.0)};
    }
}

HIL_INLINE Vec<D> triangle_normal(const CastMesh &mesh, std::int32_t part) {
    double v[3][3], e[3], f[3];
    for (int c = 0; c < 3; ++c)
        for (int a = 0; a < 3; ++a) v[c][a] = mesh.vertex[3 * (long)mesh.triangle[3 * (long)part + c] + a];
    for (int a = 0; a < 3; ++a) e[a] = v[1][a] - v[0][a], f[a] = v[2][a] - v[0][a];
    return {splat<D>(e[1] * f[2] - e[2] * f[1]), splat<D>(e[2] * f[0] - e[0] * f[2]), splat<D>(e[0] * f[1] - e[1] * f[0])};
}

// Normal of each ray's geom (triangle `part` of its mesh) at o + t d if `hit`, else zeros. All in W.
HIL_INLINE Vec<D> surface_normals(const CastScene &scene, const MaskOf<D> &hit, const D &geom, const D &part, const Vec<D> &o,
                                  const Vec<D> &d, const D &t) {
    const D zero = splat<D>(0.0);
    double geoms[D::kCount], parts[D::kCount];
    store(geoms, geom), store(parts, part);
    Vec<D> found{zero, zero, zero};
    // Neighbouring rays mostly hit the same geom.
    for (unsigned left = bits(hit); left != 0;) {
        const int lane = __builtin_ctz(left);
        const auto here = hit & (geom == splat<D>(geoms[lane])) & (part == splat<D>(parts[lane]));
        left &= ~bits(here);
        const CastGeom &g = scene.geoms[(std::int32_t)geoms[lane]];
        const double *R = g.R_WG;
        Vec<D> n;
        if (g.shape == Shape::kMesh) {
            n = triangle_normal(scene.meshes[g.mesh], (std::int32_t)parts[lane]);
        } else {
            const Vec<D> r{o.x + t * d.x - g.p_WG[0], o.y + t * d.y - g.p_WG[1], o.z + t * d.z - g.p_WG[2]};
            n = solid_normal(g, {r.x * R[0] + r.y * R[3] + r.z * R[6], r.x * R[1] + r.y * R[4] + r.z * R[7],
                                 r.x * R[2] + r.y * R[5] + r.z * R[8]});
        }
        const Vec<D> n_W{R[0] * n.x + R[1] * n.y + R[2] * n.z, R[3] * n.x + R[4] * n.y + R[5] * n.z,
                         R[6] * n.x + R[7] * n.y + R[8] * n.z};
        const D length = sqrt(dot(n_W, n_W)), k = 1.0 / length;
        const auto away = dot(n_W, d) > zero, pointed = length > zero;
        // A point without a normal gets the reverse of the ray's direction.
        const D head_on = -1.0 / sqrt(dot(d, d));
        const auto against = [&](const D &n_i, const D &d_i) {
            const D unit = n_i * k;
            return select(pointed, select(away, -unit, unit), head_on * d_i);
        };
        found = {select(here, against(n_W.x, d.x), found.x), select(here, against(n_W.y, d.y), found.y),
                 select(here, against(n_W.z, d.z), found.z)};
    }
    return found;
}

}  // namespace hil::sim::frame::HIL_ISA
