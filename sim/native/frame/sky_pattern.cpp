#include "sky_pattern.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace hil::sim::frame {
namespace {

// Hash of a place of a lattice on (0, 1).
float lattice(std::uint32_t x, std::uint32_t y, std::uint32_t layer) {
    std::uint32_t h = x * 0x9e3779b1u ^ y * 0x85ebca77u ^ layer * 0xc2b2ae3du;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h = (h ^ (h >> 12)) * 0x297a2d39u;
    h ^= h >> 15;
    return (static_cast<float>(h >> 8) + 0.5f) * (1.0f / 16777216.0f);
}

// Value noise with `cells` cells to the period, blended by 3 t^2 - 2 t^3; `u` and `v` in periods.
float noise(float u, float v, std::uint32_t cells, std::uint32_t layer) {
    const float x = u * static_cast<float>(cells), y = v * static_cast<float>(cells);
    const auto x0 = static_cast<std::uint32_t>(x), y0 = static_cast<std::uint32_t>(y);
    const float a = x - static_cast<float>(x0), b = y - static_cast<float>(y0);
    const float s = a * a * (3.0f - 2.0f * a), t = b * b * (3.0f - 2.0f * b);
    const auto at = [&](std::uint32_t i, std::uint32_t j) { return lattice((x0 + i) % cells, (y0 + j) % cells, layer); };
    const float low = at(0, 0) + s * (at(1, 0) - at(0, 0)), high = at(0, 1) + s * (at(1, 1) - at(0, 1));
    return low + t * (high - low);
}

float octaves(float u, float v, std::uint32_t cells, int count, std::uint32_t layer) {
    float sum = 0.0f, weight = 0.5f, all = 0.0f;
    for (int i = 0; i < count; ++i) {
        sum += weight * noise(u, v, cells, layer + static_cast<std::uint32_t>(i));
        all += weight;
        weight *= 0.5f;
        cells *= 2;
    }
    return sum / all;
}

SkyPattern make() {
    SkyPattern pattern;
    constexpr float kPer = 1.0f / kSkyTile, kStep = 1.0f / kSkylineSteps;
    for (int row = 0; row < kSkyTile; ++row) {
        for (int column = 0; column < kSkyTile; ++column) {
            pattern.tile.push_back(octaves(static_cast<float>(column) * kPer, static_cast<float>(row) * kPer, 4, 5, 1));
        }
    }
    for (int i = 0; i <= kSkylineSteps; ++i) {
        const float u = static_cast<float>(i % kSkylineSteps) * kStep;
        // Wooded: its edge is as uneven as the tops of trees some kilometres away. It ends where the noise is low.
        const float hill = octaves(u, 0.5f, 7, 3, 21), trees = octaves(u, 0.25f, 128, 2, 31);
        pattern.near_sine.push_back(std::max(0.004f, 0.055f * (hill - 0.38f)) + 0.005f * trees);
        pattern.far_sine.push_back(0.008f + 0.060f * std::max(0.0f, octaves(u, 0.75f, 5, 5, 41) - 0.30f));
    }
    return pattern;
}

}  // namespace

const SkyPattern &sky_pattern() {
    static const SkyPattern pattern = make();
    return pattern;
}

}  // namespace hil::sim::frame
