#include "satellite_orbit.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

namespace {
constexpr double kEarthRate = 7.2921151467e-5;  // rad/s, IS-GPS-200
constexpr int kKeplerSteps = 8;
}  // namespace

void satellite_position(const SatelliteOrbit &orbit, double t_s, double out[3]) {
    const double a = orbit.semi_major_m, e = orbit.eccentricity, tk = t_s - orbit.toa_s;
    const double motion = std::sqrt(orbit.mu_m3ps2 / (a * a * a));
    const double mean = orbit.anomaly_rad + motion * tk;
    double eccentric = mean;
    for (int step = 0; step < kKeplerSteps; ++step) {
        eccentric -= (eccentric - e * det::sin(eccentric) - mean) / (1.0 - e * det::cos(eccentric));
    }
    const double sin_e = det::sin(eccentric), cos_e = det::cos(eccentric), part = 1.0 - e * cos_e;
    const double sin_v = std::sqrt(1.0 - e * e) * sin_e / part, cos_v = (cos_e - e) / part;
    const double sin_w = det::sin(orbit.perigee_rad), cos_w = det::cos(orbit.perigee_rad);
    const double sin_u = sin_v * cos_w + cos_v * sin_w, cos_u = cos_v * cos_w - sin_v * sin_w;
    const double node = orbit.node_rad + (orbit.node_rate_radps - kEarthRate) * tk - kEarthRate * orbit.toa_week_s;
    const double sin_o = det::sin(node), cos_o = det::cos(node);
    const double sin_i = det::sin(orbit.inclination_rad), cos_i = det::cos(orbit.inclination_rad);
    const double r = a * part;
    out[0] = r * (cos_u * cos_o - sin_u * cos_i * sin_o);
    out[1] = r * (cos_u * sin_o + sin_u * cos_i * cos_o);
    out[2] = r * sin_u * sin_i;
}

}  // namespace hil::sim
