// Normal of a surface where a ray met it. Contract: ray_cast.hpp.
#include <cmath>

#include "ray_cast.hpp"

namespace hil::sim::frame {
namespace {

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Outward normal, of any length, at the point q of a solid's surface, in its own frame.
void solid_normal(const Geom &g, const double *q, double *n) {
    const double *s = g.size;
    n[0] = n[1] = n[2] = 0.0;
    switch (g.shape) {
        case Shape::kSphere: n[0] = q[0], n[1] = q[1], n[2] = q[2]; break;
        case Shape::kCapsule:
            n[0] = q[0], n[1] = q[1];
            n[2] = q[2] > s[1] ? q[2] - s[1] : q[2] < -s[1] ? q[2] + s[1] : 0.0;
            break;
        case Shape::kEllipsoid:
            for (int i = 0; i < 3; ++i) n[i] = q[i] / (s[i] * s[i]);
            break;
        case Shape::kCylinder:
            // Side or end: whichever surface is nearer.
            if (std::fabs(std::fabs(q[2]) - s[1]) < std::fabs(std::sqrt(q[0] * q[0] + q[1] * q[1]) - s[0])) {
                n[2] = q[2];
            } else {
                n[0] = q[0], n[1] = q[1];
            }
            break;
        case Shape::kBox: {
            int face = 0;
            for (int i = 1; i < 3; ++i)
                if (std::fabs(std::fabs(q[i]) - s[i]) < std::fabs(std::fabs(q[face]) - s[face])) face = i;
            n[face] = q[face];
            break;
        }
        default: n[2] = 1.0;
    }
}

void triangle_normal(const Mesh &mesh, std::int32_t part, double *n) {
    double v[3][3];
    for (int c = 0; c < 3; ++c)
        for (int a = 0; a < 3; ++a) {
            const std::int32_t corner = mesh.triangle[static_cast<std::size_t>(3 * part + c)];
            v[c][a] = mesh.vertex[static_cast<std::size_t>(3 * corner + a)];
        }
    double e[3], f[3];
    for (int a = 0; a < 3; ++a) e[a] = v[1][a] - v[0][a], f[a] = v[2][a] - v[0][a];
    n[0] = e[1] * f[2] - e[2] * f[1], n[1] = e[2] * f[0] - e[0] * f[2], n[2] = e[0] * f[1] - e[1] * f[0];
}

}  // namespace

void NormalFinder::find(std::int32_t geom, std::int32_t part, const double p_W[3], const double d_W[3],
                        double out[3]) {
    // Neighbouring triangles of a mesh, and the same triangle of neighbouring geoms, in places of their own.
    const auto place = static_cast<std::size_t>(static_cast<std::uint32_t>(part) + 7u * static_cast<std::uint32_t>(geom));
    Normal &at = kept_[place % kKept];
    if (geom != at.geom || part != at.part) {
        const Geom &g = geometry_.geoms()[static_cast<std::size_t>(geom)];
        const bool triangle = g.mesh >= 0 && part >= 0;
        double n[3];
        if (triangle) {
            triangle_normal(geometry_.meshes()[static_cast<std::size_t>(g.mesh)], part, n);
        } else {
            const double r[3] = {p_W[0] - g.p_WG[0], p_W[1] - g.p_WG[1], p_W[2] - g.p_WG[2]};
            double q[3];
            for (int i = 0; i < 3; ++i) q[i] = r[0] * g.R_WG[i] + r[1] * g.R_WG[3 + i] + r[2] * g.R_WG[6 + i];
            solid_normal(g, q, n);
        }
        for (int i = 0; i < 3; ++i) at.n_W[i] = dot(g.R_WG + 3 * i, n);
        at.length = std::sqrt(dot(at.n_W, at.n_W));
        const double k = 1.0 / at.length;
        for (int i = 0; i < 3; ++i) at.unit_W[i] = at.n_W[i] * k;
        const bool flat = triangle || g.shape == Shape::kPlane;
        at.geom = flat ? geom : -1, at.part = part;
    }
    if (at.length > 0.0) {
        const bool away = dot(at.n_W, d_W) > 0.0;
        for (int i = 0; i < 3; ++i) out[i] = away ? -at.unit_W[i] : at.unit_W[i];
    } else {  // a point without a normal: as if met head on
        const double k = -1.0 / std::sqrt(dot(d_W, d_W));
        for (int i = 0; i < 3; ++i) out[i] = k * d_W[i];
    }
}

}  // namespace hil::sim::frame
