// False returns of a LiDAR from rain and snow. The model and its tables are in sim/sensors/lidar_drops.py.
//
// Determinism: + - * / sqrt, comparisons, detmath and philox. Caller-owned arrays; no allocation.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim::frame {

// Drops that the device can detect.
struct LidarDrops {
    std::uint64_t key[2];
    bool strongest, last;  // the echo that the device reports; neither: the first
    double aperture_m, divergence_rad;
    double two_way_per_m;
    double least_power;     // of a detected echo: strength / range^2
    double least_strength;  // of a detected drop
    double reflectivity, water_scale, water_power, slope_per_mm, largest_mm;
};

// nearest[k]: probability that a detectable drop is within from_m + k step_m; `nodes` of them, not falling.
struct NearestDrop {
    const double *probability;
    std::size_t nodes;
    double from_m, step_m;
};

// Ray i of the sweep uses draw first + i. Where a drop is reported instead of the surface, range_m, strength and geom of
// element place[i] become the drop's, with `geom_of_drop`. Returns the number of drops.
std::size_t add_drops(const LidarDrops &, const NearestDrop &, std::uint64_t first, const std::int32_t *place,
                      std::size_t count, std::int32_t geom_of_drop, double *range_m, double *strength,
                      std::int32_t *geom);

}  // namespace hil::sim::frame
