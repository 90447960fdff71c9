// Element by element, so each instruction set's lanes give the same whole numbers. See picture_values.hpp.
#include "picture_values.hpp"

#include <cstring>

namespace hil::sim::frame::HIL_ISA {

namespace {

void depth(const float *__restrict depth_m, double steps_per_m, std::size_t n, std::uint16_t *__restrict out) {
    for (std::size_t i = 0; i < n; ++i) {
        const double steps = static_cast<double>(depth_m[i]) * steps_per_m + 0.5;
        const bool finite = depth_m[i] - depth_m[i] == 0.0f;
        const double above = steps < 1.0 ? 1.0 : steps;
        const double kept = above < 65535.0 ? above : 65535.0;  // NaN: 65535, not used
        out[i] = static_cast<std::uint16_t>(static_cast<std::int32_t>(kept) & -static_cast<std::int32_t>(finite));
    }
}

// Bytes at a time: enough that what was stored is there when its neighbours ask for it; a multiple of 3.
constexpr std::size_t kBlock = 1920;

struct Firsts {
    std::uint8_t of[kBlock];  // 255 at the first component of each normal

    constexpr Firsts() : of{} {
        for (std::size_t i = 0; i < kBlock; i += 3) of[i] = 255;
    }
};

constexpr Firsts kFirsts;

void values(const float *__restrict normal, std::size_t n, std::uint8_t *__restrict out) {
    for (std::size_t i = 0; i < n; ++i) {
        const float x = normal[i];
        const float above = x >= -1.0f ? x : -1.0f;  // NaN: -1
        const float cut = above <= 1.0f ? above : 1.0f;
        out[i] = static_cast<std::uint8_t>(static_cast<std::int32_t>(cut * 127.0f + 128.5f));
    }
}

void normal(const float *__restrict normal, std::size_t n, std::uint8_t *__restrict out) {
    const std::size_t size = 3 * n;
    // A unit vector has a part above 0.5: three times 128 is the zero vector. Every byte asks its neighbours, so that
    // no loop steps by threes.
    std::uint8_t v[kBlock + 2] = {}, zero[kBlock + 2] = {};
    for (std::size_t at = 0; at < size; at += kBlock) {
        const std::size_t count = size - at < kBlock ? size - at : kBlock;
        if (count == kBlock) values(normal + at, kBlock, v);
        else values(normal + at, count, v);
        for (std::size_t i = 0; i < kBlock; ++i) {
            const auto other = static_cast<std::uint8_t>((v[i] ^ 128) | (v[i + 1] ^ 128) | (v[i + 2] ^ 128));
            zero[i + 2] = static_cast<std::uint8_t>(other == 0 ? kFirsts.of[i] : 0);
        }
        for (std::size_t i = 0; i < kBlock; ++i) {
            v[i] = static_cast<std::uint8_t>(v[i] & ~(zero[i] | zero[i + 1] | zero[i + 2]));
        }
        std::memcpy(out + at, v, count);
    }
}

}  // namespace

extern const PictureValueKernels kPictureValueKernels;
const PictureValueKernels kPictureValueKernels{depth, normal};

}  // namespace hil::sim::frame::HIL_ISA
