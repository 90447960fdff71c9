#include "lidar_drops.hpp"

#include <algorithm>
#include <cmath>

#include "detmath.hpp"
#include "noise_stream.hpp"

namespace hil::sim::frame {
namespace {

// Uniforms on (0, 1) of draw `index`: where the drop is, and how wide. Two draws share a block.
struct Pair {
    double place, width;
};

Pair uniforms(const std::uint64_t key[2], std::uint64_t index, std::uint64_t block[4], std::uint64_t &drawn) {
    const std::uint64_t wanted = index / 2 + 1;
    if (drawn != wanted) {
        const std::uint64_t counter[4] = {wanted, 0, 0, 0};
        philox(counter, key, block);
        drawn = wanted;
    }
    const auto uniform = [](std::uint64_t bits) { return ((double)(bits >> 12) + 0.5) * 0x1p-52; };
    const std::uint64_t *at = block + 2 * (index % 2);
    return {uniform(at[0]), uniform(at[1])};
}

double range_of(const NearestDrop &nearest, double probability) {
    const double *end = nearest.probability + nearest.nodes;
    const double *above = std::upper_bound(nearest.probability, end, probability);
    const double low = above[-1];
    return nearest.from_m + nearest.step_m * ((double)(above - 1 - nearest.probability) + (probability - low) / (*above - low));
}

// Strength of a detectable drop at a range: its width is distributed as that of all drops above the least one.
double strength_of(const LidarDrops &drops, double range_m, double uniform) {
    const double beam_mm = 1e3 * (drops.aperture_m + drops.divergence_rad * range_m);
    const double passed = det::exp(-drops.two_way_per_m * range_m);
    const double least_strength = std::max(drops.least_power * range_m * range_m, drops.least_strength);
    const double least_share = least_strength / (drops.reflectivity * passed);
    const double least_mm = drops.water_scale * det::pow(beam_mm * std::sqrt(least_share), drops.water_power);
    const double most = det::exp(-drops.slope_per_mm * std::min(least_mm, drops.largest_mm));
    const double fewest = det::exp(-drops.slope_per_mm * drops.largest_mm);
    const double water_mm = -det::log(most - uniform * (most - fewest)) / drops.slope_per_mm;
    const double width_mm = det::pow(water_mm / drops.water_scale, 1.0 / drops.water_power);
    const double share = width_mm / beam_mm;
    return drops.reflectivity * passed * std::min(share * share, 1.0);
}

}  // namespace

std::size_t add_drops(const LidarDrops &drops, const NearestDrop &nearest, std::uint64_t first, const std::int32_t *place,
                      std::size_t count, std::int32_t geom_of_drop, double *range_m, double *strength,
                      std::int32_t *geom) {
    const double most = nearest.probability[nearest.nodes - 1];
    std::uint64_t block[4], drawn = 0;
    std::size_t added = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const Pair u = uniforms(drops.key, first + i, block, drawn);
        if (u.place >= most) continue;
        const std::int32_t at = place[i];
        const double drop_m = range_of(nearest, u.place), met_m = range_m[at];
        if (drop_m >= met_m) continue;
        const double light = strength_of(drops, drop_m, u.width);
        const double power = strength[at] / (met_m * met_m);  // 0 without a surface
        if (drops.last && power >= drops.least_power) continue;
        if (drops.strongest && power >= light / (drop_m * drop_m)) continue;
        range_m[at] = drop_m, strength[at] = light, geom[at] = geom_of_drop;
        ++added;
    }
    return added;
}

}  // namespace hil::sim::frame
