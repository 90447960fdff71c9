#include "supersample.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

#include "../srgb.hpp"

namespace hil::sim::frame {

namespace {

constexpr int kWhite = 16320;  // linear light of one pixel, so that four fit into 16 bits

struct Curves {
    std::uint16_t linear[256];
    std::vector<std::uint8_t> code;  // of the sum of four

    Curves() : code(4 * kWhite + 1) {
        for (int i = 0; i < 256; ++i) linear[i] = static_cast<std::uint16_t>(std::lround(kWhite * srgb_to_linear(i / 255.0)));
        for (int i = 0; i <= 4 * kWhite; ++i) {
            code[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(std::lround(255.0 * linear_to_srgb(i / (4.0 * kWhite))));
        }
    }
};

}  // namespace

void mean_of_four(const std::uint8_t *fine, int width, int height, std::uint8_t *out) {
    static const Curves curves;
    const std::size_t row = 6 * static_cast<std::size_t>(width);
    for (int y = 0; y < height; ++y) {
        const std::uint8_t *top = fine + 2 * static_cast<std::size_t>(y) * row, *bottom = top + row;
        for (int x = 0; x < width; ++x) {
            for (int i = 0; i < 3; ++i) {
                const int at = 6 * x + i;
                const int sum = curves.linear[top[at]] + curves.linear[top[at + 3]] + curves.linear[bottom[at]] +
                                curves.linear[bottom[at + 3]];
                *out++ = curves.code[static_cast<std::size_t>(sum)];
            }
        }
    }
}

}  // namespace hil::sim::frame
