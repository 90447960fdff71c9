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

const Curves &curves() {
    static const Curves made;
    return made;
}

}  // namespace

void mean_of_pixels(const std::uint8_t *const *pixel, std::uint8_t *out) {
    const Curves &curve = curves();
    for (int i = 0; i < 3; ++i) {
        const int sum = curve.linear[pixel[0][i]] + curve.linear[pixel[1][i]] + curve.linear[pixel[2][i]] + curve.linear[pixel[3][i]];
        out[i] = curve.code[static_cast<std::size_t>(sum)];
    }
}

void mean_of_four(const std::uint8_t *fine, int width, int height, std::uint8_t *out) {
    const Curves &curve = curves();
    const std::size_t row = 6 * static_cast<std::size_t>(width);
    for (int y = 0; y < height; ++y) {
        const std::uint8_t *top = fine + 2 * static_cast<std::size_t>(y) * row, *bottom = top + row;
        for (int x = 0; x < width; ++x) {
            for (int i = 0; i < 3; ++i) {
                const int at = 6 * x + i;
                const int sum = curve.linear[top[at]] + curve.linear[top[at + 3]] + curve.linear[bottom[at]] +
                                curve.linear[bottom[at + 3]];
                *out++ = curve.code[static_cast<std::size_t>(sum)];
            }
        }
    }
}

}  // namespace hil::sim::frame
