// Pictures of half the size: each pixel is the mean of 2 x 2 in linear light, in integers: same bits on every machine.
#pragma once

#include <cstdint>

namespace hil::sim::frame {

// `fine`: [2 height][2 width][3] sRGB; `out`: [height][width][3].
void mean_of_four(const std::uint8_t *fine, int width, int height, std::uint8_t *out);

// The mean of four pixels.
void mean_of_pixels(const std::uint8_t *const *pixel, std::uint8_t *out);

}  // namespace hil::sim::frame
