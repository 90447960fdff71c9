// The channels of one picture, each between two strips that nobody may write to.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "resolve.hpp"

namespace fuzz {

class Guarded {
public:
    static constexpr std::size_t kStrip = 192;  // bytes
    static constexpr unsigned char kUntouched = 0xA5;

    explicit Guarded(std::size_t bytes) : data_(bytes + 2 * kStrip, kUntouched), bytes_(bytes) {}
    unsigned char *begin() { return data_.data() + kStrip; }
    const unsigned char *begin() const { return data_.data() + kStrip; }
    bool intact() const { return untouched(0, kStrip) && untouched(kStrip + bytes_, data_.size()); }
    // Whether bytes [from, to) of the channel are as they were made.
    bool never_written(std::size_t from, std::size_t to) const { return untouched(kStrip + from, kStrip + to); }

private:
    bool untouched(std::size_t from, std::size_t to) const {
        for (std::size_t i = from; i < to; ++i)
            if (data_[i] != kUntouched) return false;
        return true;
    }
    std::vector<unsigned char> data_;
    std::size_t bytes_;
};

// All nine channels; `wanted` has a bit for each, the others are neither given nor touched.
class Channels {
public:
    static constexpr std::size_t kBytes[9] = {4, 4, 12, 4, 1, 1, 3, 2, 4};  // a pixel, in the order of ChannelOutputs

    Channels(int width, int height, unsigned wanted) : width_(width), height_(height), wanted_(wanted) {
        const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
        for (int i = 0; i < 9; ++i) parts_.emplace_back(has(i) ? pixels * kBytes[i] : 0);
    }
    bool has(int channel) const { return (wanted_ >> channel & 1u) != 0; }

    hil::sim::frame::ChannelOutputs outputs() {
        hil::sim::frame::ChannelOutputs out;
        if (has(0)) out.depth = at<float>(0);
        if (has(1)) out.range = at<float>(1);
        if (has(2)) out.normal = at<float>(2);
        if (has(3)) out.radial_velocity = at<float>(3);
        if (has(4)) out.segmentation = at<std::uint8_t>(4);
        if (has(5)) out.material = at<std::uint8_t>(5);
        if (has(6)) out.rgb = at<std::uint8_t>(6);
        if (has(7)) out.instance = at<std::uint16_t>(7);
        if (has(8)) out.geom = at<std::int32_t>(8);
        return out;
    }
    bool intact() const {
        for (const auto &part : parts_)
            if (!part.intact()) return false;
        return true;
    }
    // The first pixel that differs, as words: where, and the distance and geom that both have there.
    std::string first_difference(const Channels &other, int row0, int row1) const {
        for (int y = row0; y < row1; ++y) {
            for (int x = 0; x < width_; ++x) {
                for (int i = 0; i < 9; ++i) {
                    if (!has(i) || !other.has(i)) continue;
                    const std::size_t from = kBytes[i] * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                                          static_cast<std::size_t>(x));
                    const auto part = static_cast<std::size_t>(i);
                    if (std::memcmp(parts_[part].begin() + from, other.parts_[part].begin() + from, kBytes[i]) != 0) {
                        return "pixel (" + std::to_string(x) + ", " + std::to_string(y) + "), channel " +
                               std::to_string(i) + "; " + seen(x, y) + ", and " + other.seen(x, y);
                    }
                }
            }
        }
        return "";
    }
    bool only_rows(int row0, int row1) const {
        for (int i = 0; i < 9; ++i) {
            if (!has(i)) continue;
            const auto &part = parts_[static_cast<std::size_t>(i)];
            const auto [from, to] = span(i, row0, row1);
            if (!part.never_written(0, from) || !part.never_written(to, span(i, 0, height_).second)) return false;
        }
        return true;
    }

private:
    template <class T>
    T *at(std::size_t channel) {
        return reinterpret_cast<T *>(parts_[channel].begin());
    }
    std::pair<std::size_t, std::size_t> span(int channel, int row0, int row1) const {
        const std::size_t row = kBytes[channel] * static_cast<std::size_t>(width_);
        return {row * static_cast<std::size_t>(row0), row * static_cast<std::size_t>(row1)};
    }
    std::string seen(int x, int y) const {
        const std::size_t at = 4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                    static_cast<std::size_t>(x));
        float range = 0.0f;
        std::int32_t geom = 0;
        if (has(1)) std::memcpy(&range, parts_[1].begin() + at, 4);
        if (has(8)) std::memcpy(&geom, parts_[8].begin() + at, 4);
        return "geom " + std::to_string(geom) + " at " + std::to_string(range) + " m";
    }
    int width_, height_;
    unsigned wanted_;
    std::vector<Guarded> parts_;
};

}  // namespace fuzz
