// Clouds and distant land: values on (0, 1) that sky.hpp looks up. The same for every scene and seed.
#pragma once

#include <vector>

namespace hil::sim::frame {

constexpr int kSkyTile = 256;      // values along an edge of the tile of clouds, which repeats
constexpr int kSkylineSteps = 1024;  // round the horizon; a further one repeats the first

struct SkyPattern {
    // Sum of five octaves of value noise, row by row: thickness of clouds, and which crop a distant field bears.
    std::vector<float> tile;
    // Height of a near and a far range of hills above the horizon, as the sine of their elevation. Their place is the
    // angle round the horizon in the norm |x| + |y|: 0 east, 1 north, 2 west, 3 south, in kSkylineSteps / 4 steps each.
    std::vector<float> near_sine, far_sine;
};

// Returns the pattern, made at the first call.
const SkyPattern &sky_pattern();

}  // namespace hil::sim::frame
