// IMU samples as in PX4's simulator: an int16 FIFO, accelerometer in steps of g/2048 within +-16 g, gyro in steps of
// 2000/32768 deg/s. Plain functions of doubles; NaN stays NaN.
#pragma once

#include <cmath>

#include "rotation.hpp"

namespace hil::flight {

inline double fifo_value(double x, double step) {
    const double most = 32767.0 * step, per_step = 1.0 / step;
    const double words = std::nearbyint(clamp(x, -most, most) * per_step);
    return (words + 0.0) * step;  // no negative zero, as in an integer
}

inline Vec3 fifo_force(Vec3 force_mps2) {
    constexpr double kStep = 9.80665 / 2048.0;
    return {fifo_value(force_mps2.x, kStep), fifo_value(force_mps2.y, kStep), fifo_value(force_mps2.z, kStep)};
}

inline Vec3 fifo_rate(Vec3 rate_radps) {
    constexpr double kStep = 2000.0 / 32768.0 * (det::kPi / 180.0);
    return {fifo_value(rate_radps.x, kStep), fifo_value(rate_radps.y, kStep), fifo_value(rate_radps.z, kStep)};
}

}  // namespace hil::flight
