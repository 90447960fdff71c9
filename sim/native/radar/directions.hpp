// Quantities computed once per direction of a picture: solid angles, angles and antenna gain.
//
// Frame R: x forward, y left, z up. Determinism: + - * / sqrt and detmath.hpp. Caller-owned arrays; no allocation.
#pragma once

#include <cstddef>

namespace hil::sim::radar {

// Solid angle [sr] of the pixels between unit directions of their corners, [height + 1][width + 1][3]. Each is two
// spherical triangles (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983, p. 125): neighbours share their
// edges, and the pixels of a pinhole add up to its field of view.
void pixel_solid_angles(const double *corners, std::size_t height, std::size_t width, double *out);

// azimuth = atan2(y, x), to the left; elevation = atan2(z, sqrt(x^2 + y^2)) [rad].
void azimuth_elevation(const double *direction_R, std::size_t count, double *azimuth, double *elevation);

// Gain relative to the axis: (x / sqrt(x^2 + y^2))^p (x / sqrt(x^2 + z^2))^q in front of the antenna, 0 behind it.
void cosine_pattern(const double *direction_R, std::size_t count, double p, double q, double *out);

}  // namespace hil::sim::radar
