// Sky behind everything, and what lies far away on the ground. For use in *.isa.cpp only.
//
// Plain sky: from the colour of the horizon to that of the zenith by w (2 - w), w the sine of the elevation.
//
// Clouds lie on a sheet that bends down to the horizon: the direction (e, n, w) meets it at (e, n) / (w + 0.12). Their
// thickness there is the sum of two looks at a tile of noise (sky_pattern.hpp), of different sizes, so that no period
// shows. A share c of the sky is covered where the sum is above 1 - c, about; thick clouds are darker in the middle.
//
// Distant land: two ranges of hills above the horizon, wooded and hazy. Between 150 m and 400 m fields of corn and bare
// earth and woods appear on an infinite plane, which keeps its own colour between them; from there on air lies before it
// (the share 0.8 r / (r + 5000 m) over r, the range beyond 150 m).
#pragma once

#include "resolve.hpp"
#include "sky_pattern.hpp"
#include "surface_colour.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

constexpr float kFieldsFrom_m = 150.0f, kFieldsTo_m = 400.0f;

HIL_INLINE Rgb plain_sky(const Daylight &light, const F &up) {
    const F w = min(max(up, splat<F>(0)), splat<F>(1)), k = w * (2.0f - w);
    const auto mix = [&](int i) { return light.horizon_rgb[i] + k * (light.zenith_rgb[i] - light.horizon_rgb[i]); };
    return {mix(0), mix(1), mix(2)};
}

HIL_INLINE F smooth_step(const F &x) {
    const F t = min(max(x, splat<F>(0)), splat<F>(1));
    return t * t * (3.0f - 2.0f * t);
}

HIL_INLINE Rgb mixed(const Rgb &a, const Rgb &b, const F &share) {
    return {a.r + share * (b.r - a.r), a.g + share * (b.g - a.g), a.b + share * (b.b - a.b)};
}

// The tile at (u, v) in periods, between its values.
HIL_INLINE F tile_at(const float *tile, const F &u, const F &v) {
    const F x = within_copy(u) * (float)kSkyTile, y = within_copy(v) * (float)kSkyTile, x0 = floor(x), y0 = floor(y);
    const F a = x - x0, b = y - y0;
    constexpr std::int32_t kLast = kSkyTile - 1;
    const I column = truncate(x0) & kLast, row = shift_left(truncate(y0) & kLast, 8);
    const I right = (column + (std::int32_t)1) & kLast, above = (row + (std::int32_t)kSkyTile) & (std::int32_t)(kSkyTile * kSkyTile - 1);
    const F low = gather(tile, row + column), high = gather(tile, above + column);
    const F low_right = gather(tile, row + right), high_right = gather(tile, above + right);
    const F p = low + a * (low_right - low), q = high + a * (high_right - high);
    return p + b * (q - p);
}

HIL_INLINE F skyline_at(const float *table, const F &x) {
    const I low = truncate(x);
    const F a = gather(table, low), b = gather(table, low + (std::int32_t)1);
    return a + (x - to_float(low)) * (b - a);
}

// Light of land of an albedo under sun and sky.
HIL_INLINE Rgb lit_land(const Daylight &light, float r, float g, float b) {
    const float sun = light.sun_W[2] > 0.0f ? 0.8f * light.sun_W[2] : 0.0f;
    const auto of = [&](float albedo, int i) { return splat<F>(albedo * (light.sky_rgb[i] + sun * light.sun_rgb[i])); };
    return {of(r, 0), of(g, 1), of(b, 2)};
}

// Colour of the sky in directions (e, n, w) in W, unit.
HIL_NOINLINE Rgb sky_with_clouds(const Daylight &light, const SkyPattern &pattern, const Vec<F> &to) {
    const F zero = splat<F>(0);
    const Rgb plain = plain_sky(light, to.z);
    const Rgb horizon{splat<F>(light.horizon_rgb[0]), splat<F>(light.horizon_rgb[1]), splat<F>(light.horizon_rgb[2])};
    Rgb c = plain;
    if (light.clouds > 0.0f) {
        const F per = 1.0f / (max(to.z, zero) + 0.12f);
        const F u = to.x * per * 0.21f + 0.37f, v = to.y * per * 0.21f + 0.61f;
        const F thick = 0.66f * tile_at(pattern.tile.data(), u, v) + 0.34f * tile_at(pattern.tile.data(), 2.6f * v - u, 2.6f * u + v);
        const float edge = 0.68f - 0.36f * light.clouds;
        const F cover = smooth_step((thick - edge) * 7.0f), deep = smooth_step((thick - edge - 0.05f) * 5.0f);
        // Clouds are white where the sun reaches them, and grey below.
        const float sun = 0.62f, sky = 0.45f;
        const auto white = [&](int i) { return light.sun_rgb[i] * sun + light.sky_rgb[i] * sky; };
        const F shade = 1.0f - 0.34f * deep;
        const Rgb cloud{shade * white(0), shade * white(1), shade * white(2)};
        const F clear = min(max(to.z * 6.0f, zero), splat<F>(1));  // they fade into the haze above the horizon
        c = mixed(c, cloud, cover * (0.25f + 0.65f * clear));
    }
    if (!any(to.z < splat<F>(0.07f))) return c;
    // Place round the horizon in the norm |x| + |y|.
    const F share = to.y / max(abs(to.x) + abs(to.y), splat<F>(1e-6f));
    const F quarter = select(to.x < zero, 2.0f - share, select(to.y < zero, 4.0f + share, share));
    const F place = min(max(quarter * (kSkylineSteps / 4.0f), zero), splat<F>(kSkylineSteps - 0.01f));
    const Rgb far = mixed(lit_land(light, 0.07f, 0.09f, 0.08f), horizon, splat<F>(0.62f));
    const Rgb near = mixed(lit_land(light, 0.045f, 0.075f, 0.03f), horizon, splat<F>(0.30f));
    const I behind = to.z < skyline_at(pattern.far_sine.data(), place), before = to.z < skyline_at(pattern.near_sine.data(), place);
    c = {select(behind, far.r, c.r), select(behind, far.g, c.g), select(behind, far.b, c.b)};
    return {select(before, near.r, c.r), select(before, near.g, c.g), select(before, near.b, c.b)};
}

// Fields and air on an infinite plane: `c`, the plane's colour at the points p of W at the range r.
HIL_NOINLINE Rgb distant_ground(const Daylight &light, const SkyPattern &pattern, const F &x, const F &y, const F &range, const Rgb &c) {
    // Fields some 120 m wide, whose edges are straight: the noise at the middle of each.
    const F column = floor(x * (1.0f / 170.0f) + y * (1.0f / 900.0f)), row = floor(y * (1.0f / 110.0f) - x * (1.0f / 700.0f));
    const F crop = tile_at(pattern.tile.data(), column * 0.3819f, row * 0.2764f);
    const F grown = tile_at(pattern.tile.data(), x * (1.0f / 260.0f), y * (1.0f / 260.0f));
    const Rgb wheat = lit_land(light, 0.30f, 0.25f, 0.11f);
    const Rgb earth = lit_land(light, 0.16f, 0.12f, 0.08f), wood = lit_land(light, 0.035f, 0.06f, 0.022f);
    Rgb field = mixed(c, wheat, smooth_step((crop - 0.52f) * 14.0f));
    field = mixed(field, earth, smooth_step((0.42f - crop) * 14.0f));
    field = mixed(field, wood, smooth_step((grown - 0.56f) * 20.0f));
    const Rgb far = mixed(c, field, smooth_step((range - kFieldsFrom_m) * (1.0f / (kFieldsTo_m - kFieldsFrom_m))));
    const Rgb horizon{splat<F>(light.horizon_rgb[0]), splat<F>(light.horizon_rgb[1]), splat<F>(light.horizon_rgb[2])};
    const F beyond = max(range - kFieldsFrom_m, splat<F>(0));
    return mixed(far, horizon, beyond / (beyond + 5000.0f) * 0.8f);
}

// Puts sky and distant land into a block's colour. `seen`: where there is a surface, at t d; d: rays in C.
HIL_INLINE void put_surroundings(const ResolveJob &job, const std::int32_t *geoms, const Vec<F> &d, const F &t, const I &seen, Rgb &c) {
    const Daylight &light = *job.light;
    const bool plain = light.clouds < 0.0f;
    I far = splat<I>(0);
    if (!plain && any(seen & (t > splat<F>(kFieldsFrom_m)))) {
        std::int32_t planes[16];
        for (int i = 0; i < 16; ++i) planes[i] = geoms[i] >= 0 && job.geoms[geoms[i]].shape == Shape::kPlane ? -1 : 0;
        far = load<I>(planes) & seen & (t > splat<F>(kFieldsFrom_m));
    }
    const bool open = bits(seen) != 0xffffu;
    if (!open && !any(far)) return;
    const F per = 1.0f / length_of(d);
    if (plain) {
        const Rgb above = plain_sky(light, (d.x * job.up_C[0] + d.y * job.up_C[1] + d.z * job.up_C[2]) * per);
        c = {select(seen, c.r, above.r), select(seen, c.g, above.g), select(seen, c.b, above.b)};
        return;
    }
    const float *m = job.camera_to_world;
    const Vec<F> to{d.x * m[0] + d.y * m[1] + d.z * m[2], d.x * m[3] + d.y * m[4] + d.z * m[5], d.x * m[6] + d.y * m[7] + d.z * m[8]};
    const SkyPattern &pattern = *job.pattern;
    if (open) {
        const Rgb above = sky_with_clouds(light, pattern, {to.x * per, to.y * per, to.z * per});
        c = {select(seen, c.r, above.r), select(seen, c.g, above.g), select(seen, c.b, above.b)};
    }
    if (any(far)) {
        const F at = select(far, t, splat<F>(0));
        const Rgb land = distant_ground(light, pattern, job.p_WC[0] + at * to.x, job.p_WC[1] + at * to.y, at / per, c);
        c = {select(far, land.r, c.r), select(far, land.g, c.g), select(far, land.b, c.b)};
    }
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
