// Rays of a sweep from a moving vehicle, each from the vehicle's pose when it fires.
//
// With s the time of a ray from the capture (s <= 0), and f(s) = s (f1 + s (f2 + s f3)):
//
//     q(s) = q_WB exp(f(s)),    p(s) = p + s (c1 + s (c2 + s c3))
//     origin_W = p(s) + R(q(s)) origin_B,    direction_W = R(q(s)) direction_B
//
// exp of a rotation vector f is (cos |f|/2, f sin(|f|/2) / |f|). sim/sensors/sweep_motion.py derives the coefficients.
//
// Determinism: + - * / sqrt and detmath.hpp, the same bits with every instruction set. Caller-owned arrays of `count`
// rows that do not overlap; no allocation.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.hpp"

namespace hil::sim::frame {

struct SweepMotion {
    double p[3], c1[3], c2[3], c3[3];  // in W
    double q_WB[4];                    // w-x-y-z, unit
    double f1[3], f2[3], f3[3];        // in B
};

// Box of all origins; lo > hi without rays.
struct SweepBox {
    double lo[3], hi[3];
};

using SweepKernel = void (*)(const SweepMotion &, const std::int32_t *time_offset_ns, const double *origin_B,
                             const double *direction_B, double *origin_W, double *direction_W, std::size_t count,
                             SweepBox &box);
SweepKernel sweep_kernel(Isa isa);

// cos x and sin x / x from x^2, for x beyond the range of the series.
void far_cos_and_sinc(double x2, double &cosine, double &sinc);

}  // namespace hil::sim::frame
