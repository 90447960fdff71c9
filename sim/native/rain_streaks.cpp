#include "rain_streaks.hpp"

#include <algorithm>
#include <cmath>

#include "detmath.hpp"
#include "noise_stream.hpp"

namespace hil::sim {
namespace {

constexpr double kDisc = 0.25 * det::kPi;  // area of a disc / the square of its width
constexpr double kMaxPoints = 4096.0;      // along a streak, and strips across it

// Adds `mass` at a point of the picture, shared among the four pixels around it by their distance.
void splat(const StreakCamera &camera, double u, double v, double mass, float *opacity) {
    const double left = std::floor(u - 0.5), top = std::floor(v - 0.5);
    const double right_share = u - 0.5 - left, low_share = v - 0.5 - top;
    for (int down = 0; down < 2; ++down) {
        const double y = top + down;
        if (!(y >= 0.0 && y < (double)camera.height)) continue;
        for (int across = 0; across < 2; ++across) {
            const double x = left + across;
            if (!(x >= 0.0 && x < (double)camera.width)) continue;
            const double share = (across ? right_share : 1.0 - right_share) * (down ? low_share : 1.0 - low_share);
            opacity[(std::size_t)y * camera.width + (std::size_t)x] += (float)(mass * share);
        }
    }
}

// The image of a drop is a disc of `wide` pixels that moves by (du, dv) in the exposure: strips along the motion, each as
// long as the motion and its chord of the disc, with the chord's part of the disc's area, in points at most a pixel apart.
void draw(const StreakCamera &camera, double u, double v, double du, double dv, double wide, float *opacity) {
    const double length = std::sqrt(du * du + dv * dv);
    const double way_u = length > 0.0 ? du / length : 0.0, way_v = length > 0.0 ? dv / length : 1.0;
    const double strips = std::min(std::ceil(wide), kMaxPoints);
    const auto offset = [&](double j) { return wide * ((j + 0.5) / strips - 0.5); };
    const auto chord = [&](double off) { return std::sqrt(wide * wide - 4.0 * off * off); };
    double chords = 0.0;
    for (double j = 0.0; j < strips; j += 1.0) chords += chord(offset(j));
    for (double j = 0.0; j < strips; j += 1.0) {
        const double off = offset(j), reach = length + chord(off);
        const double points = std::min(std::ceil(reach) + 1.0, kMaxPoints);
        const double mass = kDisc * wide * wide * chord(off) / (chords * points);
        for (double i = 0.0; i < points; i += 1.0) {
            const double t = reach * ((i + 0.5) / points - 0.5);
            splat(camera, u + way_u * t - way_v * off, v + way_v * t + way_u * off, mass, opacity);
        }
    }
}

}  // namespace

void draw_streaks(const StreakCamera &camera, const StreakDrops &drops, const StreakMotion &motion,
                  const std::uint64_t key[2], std::uint64_t index, std::size_t count, float *opacity) {
    const auto uniform = [](std::uint64_t bits) { return ((double)(bits >> 12) + 0.5) * 0x1p-52; };
    const double near3 = drops.near_m * drops.near_m * drops.near_m;
    for (std::size_t n = 0; n < count; ++n) {
        const std::uint64_t counter[4] = {n + 1, 0, index, 0};
        std::uint64_t bits[4];
        philox(counter, key, bits);
        const double *found = std::upper_bound(drops.share, drops.share + drops.classes, uniform(bits[0]));
        const std::size_t k = std::min((std::size_t)(found - drops.share), drops.classes - 1);
        // Uniform in the volume: in z^3, and in pixels at one z.
        const double far3 = drops.far_m[k] * drops.far_m[k] * drops.far_m[k];
        const double z_m = det::pow(near3 + uniform(bits[1]) * (far3 - near3), 1.0 / 3.0);
        const double u = uniform(bits[2]) * ((double)camera.width + 2.0 * drops.margin_px) - drops.margin_px;
        const double v = uniform(bits[3]) * ((double)camera.height + 2.0 * drops.margin_px) - drops.margin_px;
        double moved_m[3];
        for (int a = 0; a < 3; ++a) {
            moved_m[a] = (motion.air_C_mps[a] + drops.fall_mps[k] * motion.down_C[a]) * motion.exposure_s;
        }
        const double x = (u - camera.cx_px) / camera.fx_px, y = (v - camera.cy_px) / camera.fy_px;
        const double du = camera.fx_px * (moved_m[0] - x * moved_m[2]) / z_m;
        const double dv = camera.fy_px * (moved_m[1] - y * moved_m[2]) / z_m;
        draw(camera, u, v, du, dv, camera.fx_px * drops.width_m[k] / z_m, opacity);
    }
}

}  // namespace hil::sim
