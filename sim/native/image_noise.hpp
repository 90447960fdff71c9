// Effects of a camera's sensor on light, pixel by pixel: gain, vignetting, shot and read noise, 8-bit sRGB.
//
//   e = N v L                            expected electrons: L linear light 0..1, v vignetting, N electrons of white
//   x = gain (e + sqrt(e + r^2) n) / N   with shot and read noise (r electrons), n standard normal
//   pixel = sRGB(clip(x, 0, 1))
//
// Shot noise is Poisson. Here it is normal with the same mean and deviation; the skewness of the Poisson distribution,
// which is neglected, is below 0.23 from 20 electrons on.
//
// Noise is counter-based: the normals of picture `index` are a function of (key, index, position) alone. Philox4x64-10
// on the counter (position / 8, 0, index, 0) gives 8 words of 32 bits; the inverse normal distribution function is
// linear in each of 2048 cells (error below 2e-4) and exact (algorithm AS 241) in the outer 1/64 of each side.
//
// Determinism: integers, + - * / sqrt and comparisons; the tables come from detmath.hpp. No allocation after the tables
// are made, at first use (thread-safe). Caller-owned, C-contiguous buffers that do not overlap, except for
// functions that work in place.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim {

struct ImageKey {
    std::uint64_t word[2];
};

// out[i] += weight * linear light of the sRGB value rgb[i]: pictures are averaged in linear light.
void accumulate_linear(const std::uint8_t *rgb, float weight, float *out, std::size_t count);

struct Exposure {
    float gain;                  // > 0
    float electrons_at_white;    // N, > 0
    float read_noise_electrons;  // r, >= 0
    bool noisy;                  // false: n = 0
};

// linear: (pixels, 3); vignette: (pixels) factors or null; rgb: (pixels, 3) sRGB.
void expose(const float *linear, const float *vignette, const Exposure &exposure, ImageKey key, std::uint64_t index,
            std::uint8_t *rgb, std::size_t pixels);

struct DepthErrors {
    float sigma_m;             // a
    float sigma_per_m;         // b [1/m]: sigma = a + b z^2
    float step_m;              // rounding of the distance; 0: none
    float disparity_scale_m;   // f B / step of disparity: rounding of 1/z; 0: none
    float min_m, max_m;        // true or measured distances outside, or not above 0, become inf
};

// Adds errors to depth in place; inf stays inf.
void blur_depth(float *depth_m, const DepthErrors &errors, ImageKey key, std::uint64_t index, std::size_t pixels);

// Standard normals of picture `index`, for tests.
void image_normals(ImageKey key, std::uint64_t index, float *out, std::size_t count);

// sine[i], cosine[i] of angle_rad[i], the same bits on every machine.
void sin_cos(const double *angle_rad, double *sine, double *cosine, std::size_t count);

}  // namespace hil::sim
