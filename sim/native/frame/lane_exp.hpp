// exp(-x) for x >= 0, sixteen at a time: the same bits on every instruction set.
//
//     exp(-x) = 2^-k exp(-r),  k = floor(x / ln 2 + 1/2),  r = x - k ln 2 in [-0.35, 0.35]
//
// exp(-r) is its series up to r^6, relative error 2e-7; x above 87 counts as 87, where the result is 2e-38.
#pragma once

#include "lane_memory.hpp"

namespace hil::sim::frame::HIL_ISA {

HIL_INLINE F exp_of_minus(const F &x) {
    // ln 2 in two parts: k times the first is exact.
    constexpr float kPerLn2 = 1.44269504f, kLn2Hi = 0.693359375f, kLn2Lo = -2.12194440e-4f;
    const F within = min(max(x, splat<F>(0)), splat<F>(87));
    const I k = truncate(within * kPerLn2 + 0.5f);
    const F whole = to_float(k), s = (whole * kLn2Hi - within) + whole * kLn2Lo;
    const F series = s * (s * (s * (s * (s * (s * (1.0f / 720.0f) + 1.0f / 120.0f) + 1.0f / 24.0f) + 1.0f / 6.0f) + 0.5f) + 1.0f) + 1.0f;
    return series * as<F>(shift_left((std::int32_t)127 - k, 23));
}

}  // namespace hil::sim::frame::HIL_ISA
