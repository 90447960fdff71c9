// Streaks that falling drops draw in a picture. The model is in sim/frame/rain_streaks.py.
//
// Determinism: + - * / sqrt, comparisons, detmath and philox. Caller-owned arrays; no allocation.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim {

struct StreakCamera {
    double fx_px, fy_px, cx_px, cy_px;
    std::size_t width, height;
};

// Drops that show, in classes of width: one is of class k or below with probability share[k]. A class shows from near_m
// to far_m[k].
struct StreakDrops {
    const double *share, *width_m, *far_m, *fall_mps;
    std::size_t classes;
    double near_m, margin_px;
};

// Motion during the exposure: of the air past the camera, and the direction in which drops fall in it. C: optical axes.
struct StreakMotion {
    double air_C_mps[3], down_C[3], exposure_s;
};

// Adds the opacity of `count` drops, numbers 0 to count - 1 of picture `index`, to opacity[height][width].
void draw_streaks(const StreakCamera &, const StreakDrops &, const StreakMotion &, const std::uint64_t key[2],
                  std::uint64_t index, std::size_t count, float *opacity);

}  // namespace hil::sim
