#include "image_noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "detmath.hpp"
#include "noise_stream.hpp"
#include "srgb.hpp"

namespace hil::sim {
namespace {

constexpr std::size_t kCells = 2048;  // cells of the inverse normal distribution function
constexpr std::size_t kOuter = kCells / 64;
constexpr int kCellShift = 32 - 11;
constexpr std::size_t kShades = 16384;  // levels of linear light in the table to sRGB: at most 0.2 of an 8-bit step apart
constexpr std::size_t kBatch = 768;     // normals made at once: a whole number of pixels and of Philox blocks

struct Tables {
    std::array<float, 256> linear;
    std::array<std::uint8_t, kShades> srgb;
    std::array<float, kCells + 1> normal;

    Tables() {
        for (std::size_t i = 0; i < linear.size(); ++i) {
            linear[i] = static_cast<float>(srgb_to_linear(static_cast<double>(i) / 255.0));
        }
        for (std::size_t i = 0; i < kShades; ++i) {
            const double x = static_cast<double>(i) / static_cast<double>(kShades - 1);
            srgb[i] = static_cast<std::uint8_t>(linear_to_srgb(x) * 255.0 + 0.5);
        }
        for (std::size_t i = 1; i < kCells; ++i) {
            normal[i] = static_cast<float>(normal_from_uniform(static_cast<double>(i) / static_cast<double>(kCells)));
        }
        normal[0] = normal[kCells] = 0.0f;  // in the outer cells, which are not read
    }
};

const Tables &tables() {
    static const Tables made;
    return made;
}

float normal_of(std::uint32_t bits, const Tables &table) {
    const std::size_t cell = bits >> kCellShift;
    if (cell < kOuter || cell >= kCells - kOuter) {
        return static_cast<float>(normal_from_uniform((static_cast<double>(bits) + 0.5) * 0x1p-32));
    }
    constexpr std::uint32_t kMask = (1U << kCellShift) - 1U;
    const float within = (static_cast<float>(bits & kMask) + 0.5f) * (1.0f / static_cast<float>(1U << kCellShift));
    return table.normal[cell] + within * (table.normal[cell + 1] - table.normal[cell]);
}

// Writes the normals of positions [first, first + count). `first` is a multiple of 8; `out` holds count rounded up to 8.
void fill_normals(ImageKey key, std::uint64_t index, std::size_t first, std::size_t count, float *out,
                  const Tables &table) {
    for (std::size_t i = 0; i < count; i += 8) {
        const std::uint64_t counter[4] = {(first + i) / 8, 0, index, 0};
        std::uint64_t bits[4];
        philox(counter, key.word, bits);
        for (std::size_t j = 0; j < 4; ++j) {
            out[i + 2 * j] = normal_of(static_cast<std::uint32_t>(bits[j]), table);
            out[i + 2 * j + 1] = normal_of(static_cast<std::uint32_t>(bits[j] >> 32), table);
        }
    }
}

std::uint8_t encode(float x, const Tables &table) {
    // A NaN becomes black.
    const float shade = x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    return table.srgb[static_cast<std::size_t>(shade * static_cast<float>(kShades - 1) + 0.5f)];
}

}  // namespace

void accumulate_linear(const std::uint8_t *rgb, float weight, float *out, std::size_t count) {
    const Tables &table = tables();
    for (std::size_t i = 0; i < count; ++i) out[i] += weight * table.linear[rgb[i]];
}

void expose(const float *linear, const float *vignette, const Exposure &exposure, ImageKey key, std::uint64_t index,
            std::uint8_t *rgb, std::size_t pixels) {
    const Tables &table = tables();
    const float per_electron = 1.0f / exposure.electrons_at_white;
    const float read = exposure.read_noise_electrons * per_electron;
    float normals[kBatch];
    const std::size_t count = 3 * pixels;
    for (std::size_t first = 0; first < count; first += kBatch) {
        const std::size_t here = std::min(kBatch, count - first);
        if (exposure.noisy) fill_normals(key, index, first, here, normals, table);
        for (std::size_t i = 0; i < here; ++i) {
            const std::size_t at = first + i;
            float x = linear[at];
            if (vignette != nullptr) x *= vignette[at / 3];
            if (exposure.noisy) x += std::sqrt(x * per_electron + read * read) * normals[i];
            rgb[at] = encode(exposure.gain * x, table);
        }
    }
}

void blur_depth(float *depth_m, const DepthErrors &errors, ImageKey key, std::uint64_t index, std::size_t pixels) {
    const Tables &table = tables();
    constexpr float kNothing = std::numeric_limits<float>::infinity();
    float normals[kBatch];
    for (std::size_t first = 0; first < pixels; first += kBatch) {
        const std::size_t here = std::min(kBatch, pixels - first);
        fill_normals(key, index, first, here, normals, table);
        for (std::size_t i = 0; i < here; ++i) {
            const float z = depth_m[first + i];
            float measured = kNothing;
            // Outside its range a camera measures nothing, whatever the error.
            if (z >= errors.min_m && z <= errors.max_m && z < kNothing) {
                measured = z + (errors.sigma_m + errors.sigma_per_m * z * z) * normals[i];
                if (errors.disparity_scale_m > 0.0f) {
                    // A measured distance of 0 or less gets infinite disparity, so distance 0, which becomes inf below.
                    const float steps = measured > 0.0f ? std::floor(errors.disparity_scale_m / measured + 0.5f)
                                                        : kNothing;
                    measured = steps > 0.0f ? errors.disparity_scale_m / steps : kNothing;
                } else if (errors.step_m > 0.0f) {
                    measured = std::floor(measured / errors.step_m + 0.5f) * errors.step_m;
                }
                // A NaN becomes inf.
                if (!(measured > 0.0f && measured >= errors.min_m && measured <= errors.max_m)) measured = kNothing;
            }
            depth_m[first + i] = measured;
        }
    }
}

void image_normals(ImageKey key, std::uint64_t index, float *out, std::size_t count) {
    const Tables &table = tables();
    float normals[kBatch];
    for (std::size_t first = 0; first < count; first += kBatch) {
        const std::size_t here = std::min(kBatch, count - first);
        fill_normals(key, index, first, here, normals, table);
        std::copy(normals, normals + here, out + first);
    }
}

void sin_cos(const double *angle_rad, double *sine, double *cosine, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
        sine[i] = det::sin(angle_rad[i]);
        cosine[i] = det::cos(angle_rad[i]);
    }
}

}  // namespace hil::sim
