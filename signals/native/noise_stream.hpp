// Named, counter-based noise: the generator of signals.noise.NoiseStream and of the kernels that draw noise themselves.
//
// A draw is a pure function of (key, index, lane): Philox4x64-10 (Salmon et al., SC 2011) on the counter
// (0, 0, block, 0) gives 64 bits. 52 of them form a uniform on (0, 1), which algorithm AS 241 (Wichura, 1988) maps to a
// standard normal. `key` is the BLAKE2b digest of seed and name that signals.noise.noise_key makes.
//
// Determinism: integers, + - * / sqrt and comparisons only. One allocation, at construction. Not thread-safe.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace hil {

// Inverse of the standard normal distribution function, 0 < p < 1; relative error about 1e-16.
double normal_from_uniform(double p);

// One block of the generator: 256 bits for `counter` under `key` (Philox4x64, ten rounds).
void philox(const std::uint64_t counter[4], const std::uint64_t key[2], std::uint64_t out[4]);

class NoiseStream {
  public:
    static constexpr std::uint64_t kBlock = 256;  // indices of one counter block; part of the definition of a draw
    // Indices prepared at once; affects speed only. Four indices use whole counters (four draws each) for any number of
    // lanes, and keep the cost of a sample even.
    static constexpr std::uint64_t kPiece = 4;

    NoiseStream(std::uint64_t key0, std::uint64_t key1, std::size_t lanes)
        : key_{key0, key1}, lanes_(lanes), values_(kPiece * lanes) {}

    std::size_t lanes() const { return lanes_; }

    // The `lanes` standard normals of `index`. Valid until the next call.
    const double *normal(std::uint64_t index) {
        const std::uint64_t piece = index / kPiece;
        if (piece != piece_ || !filled_) fill(piece);
        return values_.data() + (index % kPiece) * lanes_;
    }

  private:
    void fill(std::uint64_t piece);

    std::uint64_t key_[2];
    std::size_t lanes_;
    std::uint64_t piece_ = 0;
    bool filled_ = false;
    std::vector<double> values_;
};

}  // namespace hil
