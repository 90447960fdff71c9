#include "noise_block.hpp"

#include "noise_stream.hpp"
namespace hil::sim {

void uniform_block(const std::uint64_t key[2], std::uint64_t first, std::size_t count, double *out) {
    constexpr std::uint64_t kBlock = NoiseStream::kBlock;
    std::uint64_t bits[4] = {};
    bool drawn = false;
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint64_t index = first + i, within = index % kBlock, lane = within % 4;
        if (lane == 0 || !drawn) {
            // numpy's generator counts before it draws: hence the one.
            const std::uint64_t counter[4] = {within / 4 + 1, 0, index / kBlock, 0};
            philox(counter, key, bits);
            drawn = true;
        }
        // 52 bits and half a step: never 0, never 1, and 1 - p is exact.
        out[i] = (static_cast<double>(bits[lane] >> 12) + 0.5) * 0x1p-52;
    }
}

void normal_block(const std::uint64_t key[2], std::uint64_t first, std::size_t count, double *out) {
    uniform_block(key, first, count, out);
    for (std::size_t i = 0; i < count; ++i) out[i] = normal_from_uniform(out[i]);
}

}  // namespace hil::sim
