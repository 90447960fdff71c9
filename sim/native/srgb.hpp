// Transfer function of sRGB (IEC 61966-2-1), with detmath's power function: the same bits on every machine.
#pragma once

#include "detmath.hpp"

namespace hil::sim {

// Code 0..1 to linear 0..1.
inline double srgb_to_linear(double code) {
    return code <= 0.04045 ? code / 12.92 : det::pow((code + 0.055) / 1.055, 2.4);
}

// Linear 0..1 to code 0..1.
inline double linear_to_srgb(double x) {
    return x <= 0.0031308 ? 12.92 * x : 1.055 * det::pow(x, 1.0 / 2.4) - 0.055;
}

}  // namespace hil::sim
