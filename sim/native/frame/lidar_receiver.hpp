// What a LiDAR reports of the light that comes back: losses, noise, intensity, the points. sim/sensors/lidar_echo.py
// has the model; this is its arithmetic in one pass, nothing of it done for rays without an echo.
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
    double range_at_10_percent_m;  // NaN: none, everything within max_range_m is seen
    double dropout;                // probability
    double intensity_falloff_m;    // NaN: the device makes up for range
};

// The rays of one sweep in firing order, `count` of each, and what they met.
struct LidarEchoes {
    std::size_t count;
    const std::int32_t *place;  // of ray i in the three that follow
    const double *range_m;      // +inf where there is no echo
    const double *strength;     // rho cos(theta)
    const std::int32_t *geom;
    const double *direction_L, *origin_z_m;  // [count][3] and [count]
    const std::uint16_t *ring;
    const std::int32_t *time_offset_ns;
    const std::uint8_t *geom_class;  // by geom
};

// Room for `count` points; those that are reported come first, in firing order.
struct LidarCloud {
    float *points_L, *range_m, *intensity;
    std::uint16_t *ring;
    std::int32_t *time_offset_ns;
    std::uint8_t *geom_class;
};

// Ray i draws number first + i of both streams. Returns how many points are reported.
using ReceiveKernel = std::size_t (*)(const LidarReceiver &, const LidarEchoes &, std::uint64_t first,
                                      const LidarCloud &);
ReceiveKernel receive_kernel(Isa isa);

// Strength of each ray's light by Lambert's law, reflectivity times |normal . direction|; 0 where nothing was met.
void lambert_strength(const std::int32_t *geom, const double *normal_W, const double *direction_W,
                      const double *reflectivity, std::size_t count, double *strength);

}  // namespace hil::sim::frame
