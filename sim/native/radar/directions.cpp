#include "directions.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

// Signed solid angle; positive if a, b, c turn to the right as seen from the centre of the sphere.
double triangle(const double *a, const double *b, const double *c) {
    const double volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                          a[2] * (b[0] * c[1] - b[1] * c[0]);
    const auto dot = [](const double *u, const double *v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; };
    return 2.0 * det::atan2(volume, 1.0 + dot(a, b) + dot(b, c) + dot(c, a));
}

}  // namespace

void pixel_solid_angles(const double *corners, std::size_t height, std::size_t width, double *out) {
    const std::size_t row = 3 * (width + 1);
    for (std::size_t y = 0; y < height; ++y) {
        for (std::size_t x = 0; x < width; ++x) {
            const double *a = corners + y * row + 3 * x, *b = a + 3, *d = a + row, *c = d + 3;
            *out++ = std::fabs(triangle(a, b, c) + triangle(a, c, d));
        }
    }
}

void azimuth_elevation(const double *direction_R, std::size_t count, double *azimuth, double *elevation) {
    for (std::size_t i = 0; i < count; ++i) {
        const double x = direction_R[3 * i], y = direction_R[3 * i + 1], z = direction_R[3 * i + 2];
        azimuth[i] = det::atan2(y, x);
        elevation[i] = det::atan2(z, std::sqrt(x * x + y * y));
    }
}

void cosine_pattern(const double *direction_R, std::size_t count, double p, double q, double *out) {
    for (std::size_t i = 0; i < count; ++i) {
        const double x = direction_R[3 * i], y = direction_R[3 * i + 1], z = direction_R[3 * i + 2];
        if (!(x > 1e-100)) {  // below, the square underflows
            out[i] = 0.0;
            continue;
        }
        out[i] = det::pow(x / std::sqrt(x * x + y * y), p) * det::pow(x / std::sqrt(x * x + z * z), q);
    }
}

}  // namespace hil::sim::radar
