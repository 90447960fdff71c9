// Conversion of the pixels of a picture to radar echoes, in one pass: range, normal, material and radial velocity to
// range, speed, direction and amplitude.
//
// With W the factor of the radar equation that depends on the pixel's direction and size, c the cosine of incidence and
// s(c) the surface's curve sqrt(sigma0(c) / c) (reflection.hpp):
//
//     A = W s(c) / R,    c = -n_C . d_C
//
// because dA = R^2 dOmega / c turns the R^-4 of power into R^-2. The curve is interpolated linearly at u = sqrt(c).
//
// Each pixel without an echo is counted once, for the first reason that holds in the order of ScatterCounts. Pixels of
// weight 0 are neither read nor counted. Pixels with a NaN count as `invalid`.
//
// Determinism: + - * / sqrt in fixed order; all instruction sets give the same bits. Caller-owned arrays that do not
// overlap; no allocation; the echoes are in the order of the pixels.
#pragma once

#include <cstdint>

#include "../frame/isa.hpp"

namespace hil::sim::radar {

constexpr int kCurveSteps = 4096;  // steps of a surface's curve, which has one more node
constexpr int kLanes = 16;         // pixels of a block

struct PixelPicture {  // row-major
    const float *range_m;
    const float *normal_C;  // [3]
    const float *radial_velocity_mps;
    const std::uint8_t *material;
    const std::uint8_t *segmentation;  // may be null, with `class_kept`
};

struct PixelPlan {
    const float *blocks;        // [ceil(pixels / 16)][4][16]: d_C x, y, z and W; W = 0: skipped, also for padding
    const double *direction_R;  // [pixels][3]
    long pixels;
    const float *curves;  // [surfaces][kCurveSteps + 1]
    int surfaces;
    const std::uint8_t *class_kept;  // [256], or null: all
    float max_range_m;
};

struct EchoColumns {  // arrays with a row for every pixel of weight above 0
    double *range_m, *speed_mps, *direction_R, *amplitude;
};

struct ScatterCounts {
    long invalid;   // range, normal or velocity is NaN or impossible
    long sky;       // infinite range
    long nothing;   // material 0, or a surface without backscatter
    long unknown;   // material without a curve
    long range;     // beyond max_range_m
    long classes;   // segmentation class is not kept
    long away;      // normal perpendicular to the ray, or facing away
    long kept;
};

struct ScatterKernels {
    void (*collect)(const PixelPlan &, const PixelPicture &, const EchoColumns &, ScatterCounts &);
};

const ScatterKernels &scatter_kernels(frame::Isa isa);

}  // namespace hil::sim::radar
