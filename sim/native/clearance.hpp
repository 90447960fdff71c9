// Lower bound of the gap between a sphere and the static scene: ground plane z = 0 and axis-aligned boxes, in W [m].
// `boxes` is [count][6]: centre xyz, half extents xyz. Exact for spheres; a vehicle inside the sphere is farther.
// Deterministic (+ - * sqrt, comparisons), no allocation, reads only.
#pragma once

#include <cmath>
#include <cstddef>

namespace hil::sim {

inline double clearance(const double *p_W, double radius_m, const double *boxes, std::size_t count) {
    double least = p_W[2];
    for (std::size_t b = 0; b < count; ++b) {
        const double *box = boxes + 6 * b;
        double squared = 0.0;
        for (int j = 0; j < 3; ++j) {
            const double outside = std::fabs(p_W[j] - box[j]) - box[3 + j];
            if (outside > 0.0) squared += outside * outside;
        }
        const double distance = std::sqrt(squared);
        if (distance < least) least = distance;
    }
    return least - radius_m;
}

}  // namespace hil::sim
