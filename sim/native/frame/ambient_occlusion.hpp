// Share of the ambient light that reaches the pixels of a surface (sky_visibility.hpp). For use in *.isa.cpp only.
#pragma once

#include "resolve.hpp"
#include "surface_colour.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

constexpr float kBounced = 0.2f;      // light from directions that are not open, relative to those that are
constexpr float kOffSurface = 0.35f;  // [cells] along the normal, so that a wall is not shaded by its own inside

// Not inlined, as put_haze (resolve.isa.cpp).
__attribute__((noinline)) F ambient_share(const ResolveJob &job, const Surface &s, const Vec<F> &normal) {
    const SkyVisibility &sky = *job.sky;
    const float *R = job.camera_to_world;
    const auto turned = [&](const Vec<F> &v, int i) { return v.x * R[3 * i] + v.y * R[3 * i + 1] + v.z * R[3 * i + 2]; };
    const Vec<F> c{s.d.x * s.t, s.d.y * s.t, s.d.z * s.t};
    const F zero = splat<F>(0), one = splat<F>(1);
    const Vec<F> n{turned(normal, 0), turned(normal, 1), turned(normal, 2)}, outward{turned(s.normal, 0), turned(s.normal, 1), turned(s.normal, 2)};
    const F away[3] = {outward.x, outward.y, outward.z};
    I inside = s.mask, low[3];
    F part[3];
    for (int i = 0; i < 3; ++i) {
        const F x = (turned(c, i) + (job.p_WC[i] - sky.corner_W[i])) * sky.per_m + away[i] * kOffSurface;
        inside &= (x > splat<F>(-0.75f)) & (x < splat<F>((float)sky.size[i] - 0.25f));
        const F within = min(max(select(inside, x, zero), zero), splat<F>((float)sky.size[i] - 1.001f));
        low[i] = truncate(within);
        part[i] = within - to_float(low[i]);
    }
    if (!any(inside)) return one;
    const I first = (low[2] * (std::int32_t)sky.size[1] + low[1]) * (std::int32_t)sky.size[0] + low[0];
    F sum = zero;
    for (int k = 0; k < 8; ++k) {
        const std::int32_t step = (k >> 2) * sky.size[0] * sky.size[1] + (k >> 1 & 1) * sky.size[0] + (k & 1);
        const I packed = gather(sky.cell.data(), first + step);
        const auto signed_byte = [&](int shift) { return to_float(shift_right(packed, shift) & (std::int32_t)255) - 128.0f; };
        const F a = to_float(packed & (std::int32_t)255) * (1.0f / 255.0f);
        const F along = signed_byte(8) * n.x + signed_byte(16) * n.y + signed_byte(24) * n.z;
        const F weight = (k & 1 ? part[0] : 1.0f - part[0]) * (k >> 1 & 1 ? part[1] : 1.0f - part[1]) * (k >> 2 ? part[2] : 1.0f - part[2]);
        sum = sum + weight * (a + along * (2.0f / (3.0f * 127.0f)));
    }
    const F open = min(max(sum, zero), one);
    return select(inside, kBounced + (1.0f - kBounced) * open, one);
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
