// The pixels of a picture as radar echoes, in one pass: range, normal, surface and radial velocity to range, speed,
// direction and amplitude.
//
// With W what the pixel's direction and size make of the radar equation, c the cosine of incidence and s(c) the
// surface's curve sqrt(sigma0(c) / c) (reflection.hpp):
//
//     A = W s(c) / R,    c = -n_C . d_C
//
// for dA = R^2 dOmega / c turns the R^-4 of power into R^-2. The curve is read at u = sqrt(c), between its two nearest
// nodes in a straight line.
//
// What is left out is counted, each pixel once and by the first reason that holds, in the order of ScatterCounts; pixels
// of weight 0 are left out unread and uncounted. NaN never gets through: what is no number is `invalid`.
//
// Determinism: + - * / sqrt in fixed order; all instruction sets give the same bits. Caller-owned arrays that do not
// overlap; no allocation; the echoes are in the order of the pixels.
#pragma once

#include <cstdint>

#include "../frame/isa.hpp"

namespace hil::sim::radar {

constexpr int kCurveSteps = 4096;  // of a surface's curve; it has one node more
constexpr int kLanes = 16;         // pixels of a block

struct PixelPicture {  // rows one after the other
    const float *range_m;
    const float *normal_C;  // [3]
    const float *radial_velocity_mps;
    const std::uint8_t *material;
    const std::uint8_t *segmentation;  // may be null, with `class_kept`
};

struct PixelPlan {
    const float *blocks;        // [ceil(pixels / 16)][4][16]: d_C x, y, z and W; W = 0 is left out, as is what fills up
    const double *direction_R;  // [pixels][3]
    long pixels;
    const float *curves;  // [surfaces][kCurveSteps + 1]
    int surfaces;
    const std::uint8_t *class_kept;  // [256], or null: all
    float max_range_m;
};

struct EchoColumns {  // room for every pixel of weight above 0
    double *range_m, *speed_mps, *direction_R, *amplitude;
};

struct ScatterCounts {
    long invalid;   // range, normal or velocity is no number, or no possible one
    long sky;       // infinite range
    long nothing;   // material 0, or a surface that sends nothing back
    long unknown;   // a material that has no curve
    long range;     // beyond max_range_m
    long classes;   // not of a class that is kept
    long away;      // normal at right angles to the ray, or away
    long kept;
};

struct ScatterKernels {
    void (*collect)(const PixelPlan &, const PixelPicture &, const EchoColumns &, ScatterCounts &);
};

const ScatterKernels &scatter_kernels(frame::Isa isa);

}  // namespace hil::sim::radar
