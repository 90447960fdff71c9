// A run of consecutive draws of one named noise stream: what a sensor with tens of thousands of points a sample needs.
//
// The same numbers, bit for bit, as hil.signals.noise.NoiseStream with one lane at indices first, first + 1, ...
// (and noise_stream.hpp): a draw is a pure function of (key, index), so any split of a run gives the same values.
//
// `out` holds `count` doubles and is the caller's. No allocation, no state: thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim {

// Uniforms on (0, 1).
void uniform_block(const std::uint64_t key[2], std::uint64_t first, std::size_t count, double *out);

// Standard normals.
void normal_block(const std::uint64_t key[2], std::uint64_t first, std::size_t count, double *out);

}  // namespace hil::sim
