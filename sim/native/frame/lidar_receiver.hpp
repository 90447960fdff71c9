// Receiver of a LiDAR: losses, noise, intensity and points. The model is in sim/sensors/lidar_echo.py; this computes it
// in one pass and skips rays without an echo.
//
// Determinism: + - * / sqrt, comparisons and the noise of noise_stream.hpp; the bits depend neither on the instruction
// set nor on the order in which the rays were cast. Caller-owned arrays that do not overlap; no allocation.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.hpp"

namespace hil::sim::frame {

struct LidarReceiver {
    std::uint64_t noise_key[2], loss_key[2];
    double noise_m, resolution_m, min_range_m, max_range_m;
    double range_at_10_percent_m;  // NaN: no limit below max_range_m
    double dropout;                // probability
    double intensity_falloff_m;    // NaN: intensity is compensated for range
};

// Rays of one sweep in firing order, `count` values each, and their hits.
struct LidarEchoes {
    std::size_t count;
    const std::int32_t *place;  // index of ray i in range_m, strength and geom
    const double *range_m;      // +inf: no echo
    const double *strength;     // rho cos(theta)
    const std::int32_t *geom;
    const double *direction_L, *origin_z_m;  // [count][3] and [count]
    const std::uint16_t *ring;
    const std::int32_t *time_offset_ns;
    const std::uint8_t *geom_class;  // by geom
};

// Arrays of `count` rows; reported points are written to the front, in firing order.
struct LidarCloud {
    float *points_L, *range_m, *intensity;
    std::uint16_t *ring;
    std::int32_t *time_offset_ns;
    std::uint8_t *geom_class;
    std::int32_t *ray;  // number of the point's ray in firing order; may be null
};

// Ray i uses draw first + i of both noise streams. Returns the number of reported points.
using ReceiveKernel = std::size_t (*)(const LidarReceiver &, const LidarEchoes &, std::uint64_t first,
                                      const LidarCloud &);
ReceiveKernel receive_kernel(Isa isa);

// Strength of each ray's echo by Lambert's law, reflectivity times |normal . direction|; 0 without a hit.
void lambert_strength(const std::int32_t *geom, const double *normal_W, const double *direction_W,
                      const double *reflectivity, std::size_t count, double *strength);

}  // namespace hil::sim::frame
