// Depth and normals as the whole numbers that a PNG holds. What they mean: hil/dataset/formats/pictures.py.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim::frame {

// Steps of depth, rounded, 1 to 65535; 0 for what is not finite.
void depth_values(const float *depth_m, double steps_per_m, std::size_t n, std::uint16_t *out);

// Three components each of `n` normals: floor(127 n + 128.5); (0, 0, 0) for the zero vector. Components within [-1, 1];
// outside they are cut.
void normal_values(const float *normal, std::size_t n, std::uint8_t *out);

// What each instruction set makes of the loops.
struct PictureValueKernels {
    void (*depth)(const float *, double, std::size_t, std::uint16_t *);
    void (*normal)(const float *, std::size_t, std::uint8_t *);
};

}  // namespace hil::sim::frame
