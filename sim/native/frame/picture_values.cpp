#include "picture_values.hpp"

#include <algorithm>

namespace hil::sim::frame {

void depth_values(const float *depth_m, double steps_per_m, std::size_t n, std::uint16_t *out) {
    for (std::size_t i = 0; i < n; ++i) {
        const double steps = static_cast<double>(depth_m[i]) * steps_per_m + 0.5;
        const bool finite = depth_m[i] - depth_m[i] == 0.0f;
        const double kept = steps < 1.0 ? 1.0 : (steps < 65535.0 ? steps : 65535.0);  // NaN: 65535, not used
        out[i] = static_cast<std::uint16_t>(finite ? static_cast<std::int32_t>(kept) : 0);
    }
}

void normal_values(const float *normal, std::size_t n, std::uint8_t *out) {
    for (std::size_t i = 0; i < 3 * n; i += 3) {
        std::int32_t v[3];
        for (std::size_t k = 0; k < 3; ++k) {
            const float x = normal[i + k];
            const float cut = x >= -1.0f ? (x <= 1.0f ? x : 1.0f) : -1.0f;  // NaN: -1
            v[k] = static_cast<std::int32_t>(cut * 127.0f + 128.5f);
        }
        // A unit vector has a part above 0.5: three times 128 is the zero vector.
        const std::int32_t keep = -((v[0] != 128) | (v[1] != 128) | (v[2] != 128));
        for (std::size_t k = 0; k < 3; ++k) out[i + k] = static_cast<std::uint8_t>(v[k] & keep);
    }
}

}  // namespace hil::sim::frame
