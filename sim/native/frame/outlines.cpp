#include "outlines.hpp"

#include <algorithm>
#include <cstring>

#include "supersample.hpp"

namespace hil::sim::frame {

void Outlines::find(const VisibilityBuffer &buffer, int drawn0, int drawn1, int row0, int row1) {
    width_ = buffer.width, height_ = buffer.height, row0_ = row0;
    stride_ = kBlock * buffer.blocks_x + 2;
    geom_.resize(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(kBlock * buffer.blocks_y + 2));
    std::int32_t *const geom = geom_.data();
    for (int y = drawn0; y < drawn1; ++y) {
        const std::int32_t *from = &buffer.geom[static_cast<std::size_t>(16 * (y / kBlock) * buffer.blocks_x + kBlock * (y % kBlock))];
        for (int column = 0; column < buffer.blocks_x; ++column) std::memcpy(geom + at(kBlock * column, y), from + 16 * column, 16);
        geom[at(-1, y)] = geom[at(0, y)];
        geom[at(width_, y)] = geom[at(width_ - 1, y)];
    }
    const auto repeat = [&](int from, int to) { std::copy_n(geom + at(-1, from), width_ + 2, geom + at(-1, to)); };
    if (drawn0 == 0) repeat(0, -1);
    if (drawn1 == height_) repeat(height_ - 1, height_);
    pixel_.clear();
    first_of_row_.clear();
    for (int y = row0; y < row1; ++y) {
        first_of_row_.push_back(pixel_.size());
        const std::int32_t *row = geom + at(0, y), *above = row - stride_, *below = row + stride_;
        for (int x = 0; x < width_; ++x) {
            const std::int32_t own = row[x];
            if (((row[x - 1] ^ own) | (row[x + 1] ^ own) | (above[x] ^ own) | (below[x] ^ own)) != 0) pixel_.push_back(y * width_ + x);
        }
    }
    first_of_row_.push_back(pixel_.size());
    source_.resize(4 * pixel_.size());
}

const std::vector<std::uint8_t> &Outlines::finer_blocks(int blocks_x, int blocks_y) {
    finer_.assign(static_cast<std::size_t>(blocks_x) * static_cast<std::size_t>(blocks_y), 0);
    for (const std::int32_t pixel : pixel_) finer_[static_cast<std::size_t>(pixel / width_ / 2 * blocks_x + pixel % width_ / 2)] = 1;
    return finer_;
}

bool Outlines::match(const VisibilityBuffer &finer, int first, int last, std::uint16_t *lanes) {
    const std::int32_t *const geom = geom_.data();
    bool some = false;
    for (std::size_t i = first_of_row_[static_cast<std::size_t>(first - row0_)]; i < first_of_row_[static_cast<std::size_t>(last - row0_)]; ++i) {
        const int x = pixel_[i] % width_, y = pixel_[i] / width_;
        const auto block = static_cast<std::size_t>(y / 2 * finer.blocks_x + x / 2);
        const std::int32_t *const centre = geom + at(x, y);
        for (int k = 0; k < 4; ++k) {
            const int lane = 4 * (2 * (y & 1) + (k >> 1)) + 2 * (x & 1) + (k & 1);
            const std::int32_t seen = finer.geom[16 * block + static_cast<std::size_t>(lane)];
            std::int32_t &source = source_[4 * i + static_cast<std::size_t>(k)];
            source = pixel_[i];
            if (seen == *centre) continue;
            // Nearest first; those at the same distance across before along.
            const int dx = k & 1 ? 1 : -1, dy = k >> 1 ? 1 : -1;
            const int step[8][2] = {{dx, 0}, {0, dy}, {dx, dy}, {-dx, 0}, {0, -dy}, {-dx, dy}, {dx, -dy}, {-dx, -dy}};
            bool found = false;
            for (const auto &s : step) {
                if (centre[s[1] * stride_ + s[0]] != seen) continue;
                source = std::clamp(y + s[1], 0, height_ - 1) * width_ + std::clamp(x + s[0], 0, width_ - 1);
                found = true;
                break;
            }
            if (found) continue;
            lanes[block] = static_cast<std::uint16_t>(lanes[block] | 1u << lane);
            source = -1 - ((2 * y + (k >> 1)) * 2 * width_ + 2 * x + (k & 1));
            some = true;
        }
    }
    return some;
}

void Outlines::put(const std::uint8_t *rgb, const std::uint8_t *samples, int first, int last, std::uint8_t *out) const {
    for (std::size_t i = first_of_row_[static_cast<std::size_t>(first - row0_)]; i < first_of_row_[static_cast<std::size_t>(last - row0_)]; ++i) {
        const std::uint8_t *four[4];
        for (std::size_t k = 0; k < 4; ++k) {
            const std::int32_t source = source_[4 * i + k];
            four[k] = source >= 0 ? rgb + 3 * static_cast<std::ptrdiff_t>(source) : samples + 3 * static_cast<std::ptrdiff_t>(-1 - source);
        }
        mean_of_pixels(four, out + 3 * static_cast<std::ptrdiff_t>(pixel_[i]));
    }
}

}  // namespace hil::sim::frame
