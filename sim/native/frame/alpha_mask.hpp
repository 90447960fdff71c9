// Holes of meshes (AlphaMask in geometry.hpp), in lanes. For use in *.isa.cpp only.
#pragma once

#include "geometry.hpp"
#include "lane_memory.hpp"

namespace hil::sim::frame::HIL_ISA {

// Mask of the lanes `wanted` whose point of a triangle is opaque. `uv`: of the triangle's corners. `a`, `b`, `c`:
// barycentric coordinates of the corners up to a common factor.
HIL_INLINE I opaque(const AlphaMask &mask, const float *uv, const F &a, const F &b, const F &c, const I &wanted) {
    constexpr int kFewLanes = 5;
    const F zero = splat<F>(0), scale = 1.0f / select(wanted, a + b + c, splat<F>(1));
    const F wb = b * scale, wc = c * scale;
    const auto within_tile = [&](int i) {
        const F x = uv[i] + wb * (uv[2 + i] - uv[i]) + wc * (uv[4 + i] - uv[i]);
        // A mesh may have any texture coordinates; converting those out of the range of an int depends on the machine.
        return select(wanted & (abs(x) < splat<F>(1e6f)), x - floor(x), zero);
    };
    const I column = truncate(within_tile(0) * (float)mask.width) & (std::int32_t)(mask.width - 1);
    const I row = (std::int32_t)(mask.height - 1) - (truncate(within_tile(1) * (float)mask.height) & (std::int32_t)(mask.height - 1));
    const I texel = row * (std::int32_t)mask.width + column;
    unsigned lanes = bits(wanted);
    // Lane by lane where few are wanted: a gather costs as much as several.
    if (__builtin_popcount(lanes) > kFewLanes) {
        const I word = gather(mask.opaque.data(), shift_right(texel, 5));
        return wanted & ((shift_right(word, texel & (std::int32_t)31) & (std::int32_t)1) != splat<I>(0));
    }
    std::int32_t at[16];
    store(at, texel);
    unsigned hit = 0;
    for (; lanes != 0; lanes &= lanes - 1) {
        const int lane = __builtin_ctz(lanes);
        hit |= ((std::uint32_t)mask.opaque.data()[at[lane] >> 5] >> (at[lane] & 31) & 1u) << lane;
    }
    return lanes_of(hit);
}

// The same for one point, in double: the ray caster decides by the same texel as the raster.
inline bool opaque_at(const AlphaMask &mask, const float *uv, double a, double b, double c) {
    const double scale = 1.0 / (a + b + c), wb = b * scale, wc = c * scale;
    long at[2];
    for (int i = 0; i < 2; ++i) {
        const double x = uv[i] + wb * ((double)uv[2 + i] - uv[i]) + wc * ((double)uv[4 + i] - uv[i]);
        const double in_tile = __builtin_fabs(x) < 1e6 ? x - __builtin_floor(x) : 0.0;
        const int edge = i == 0 ? mask.width : mask.height;
        at[i] = (long)(in_tile * edge) & (edge - 1);
    }
    const long texel = (mask.height - 1 - at[1]) * mask.width + at[0];
    return ((std::uint32_t)mask.opaque.data()[texel >> 5] >> (texel & 31) & 1u) != 0u;
}

}  // namespace hil::sim::frame::HIL_ISA
