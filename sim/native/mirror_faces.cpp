#include "mirror_faces.hpp"

#include <cmath>
#include <vector>

namespace hil::sim {

namespace {

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Near {
    std::int32_t face;
    double side, h;  // side: +1 if the antenna is where the normal points
};

constexpr double kTooNear_m = 0.05;    // an antenna that touches a face
constexpr double kGrazing = 1.0e-3;    // |s . n| below which the image is at the transmitter's own place

}  // namespace

std::size_t mirror_hits(const double *antenna, const double *faces, std::size_t count, const double *directions,
                        std::size_t satellites, double reach_m, double max_extra_m, MirrorHit *hits, std::size_t limit) {
    std::vector<Near> near;
    for (std::size_t f = 0; f < count; ++f) {
        const double *face = faces + 7 * f;
        const double to[3] = {antenna[0] - face[0], antenna[1] - face[1], antenna[2] - face[2]};
        const double h = dot(to, face + 3);
        const double most = reach_m + face[6];
        if (std::fabs(h) < kTooNear_m || dot(to, to) > most * most) continue;
        near.push_back({static_cast<std::int32_t>(f), h > 0.0 ? 1.0 : -1.0, std::fabs(h)});
    }
    std::size_t found = 0;
    for (std::size_t s = 0; s < satellites; ++s) {
        const double *to_satellite = directions + 3 * s;
        for (const Near &one : near) {
            const double *face = faces + 7 * static_cast<std::size_t>(one.face);
            const double incidence = one.side * dot(to_satellite, face + 3);
            if (incidence < kGrazing) continue;  // the transmitter is behind the face
            const double extra = 2.0 * one.h * incidence;
            if (extra > max_extra_m) continue;
            const double d = one.h / incidence;
            MirrorHit hit;
            double off = 0.0;
            for (int k = 0; k < 3; ++k) {
                hit.normal[k] = one.side * face[3 + k];
                hit.direction[k] = to_satellite[k] - 2.0 * incidence * hit.normal[k];
                const double away = antenna[k] + d * hit.direction[k] - face[k];
                off += away * away;
            }
            if (off > face[6] * face[6]) continue;
            if (found < limit) {
                hit.satellite = static_cast<std::int32_t>(s);
                hit.face = one.face;
                hit.distance_m = d;
                hit.extra_m = extra;
                hit.cosine = incidence;
                hits[found] = hit;
            }
            ++found;
        }
    }
    return found;
}

}  // namespace hil::sim
