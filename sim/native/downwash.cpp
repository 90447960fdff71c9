#include "downwash.hpp"

#include <cmath>

#include "detmath.hpp"
#include "forces/force.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kSpread = 0.107;   // db/dz
constexpr double kEdge2 = 9.0;      // (r / b)^2 at which the jet ends

double length(const double *v) { return std::sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]); }

}  // namespace

bool jet_of(const double *s, const double *force_B, double induced2_per_n, double radius_m, int discs,
            const double *wind_W, Jet &out) {
    const double thrust = length(force_B);
    if (!(thrust > 0.0)) return false;
    const double far_wake = 2.0 * std::sqrt(induced2_per_n * thrust / discs);
    double force_W[3];
    rotate_into_world(s + kQ, force_B, force_W);
    for (int j = 0; j < 3; ++j) {
        out.origin_W[j] = s[kP + j];
        out.velocity_W[j] = -far_wake / thrust * force_W[j];
        out.axis_W[j] = out.velocity_W[j] - (s[kV + j] - wind_W[j]);
    }
    const double speed = length(out.axis_W);
    if (!(speed > 1e-6 * far_wake)) return false;  // the vehicle falls into its own wake
    for (int j = 0; j < 3; ++j) out.axis_W[j] /= speed;
    out.b0_m = radius_m * std::sqrt(static_cast<double>(discs));
    return true;
}

void add_jet(const Jet &jet, const double *p_W, double *wind_W) {
    const double d[3] = {p_W[0] - jet.origin_W[0], p_W[1] - jet.origin_W[1], p_W[2] - jet.origin_W[2]};
    const double z = (d[0] * jet.axis_W[0] + d[1] * jet.axis_W[1]) + d[2] * jet.axis_W[2];
    if (!(z > 0.0)) return;
    const double b = jet.b0_m + kSpread * z;
    const double away2 = (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2] - z * z;
    const double r2 = away2 > 0.0 ? away2 / (b * b) : 0.0;
    if (!(r2 < kEdge2)) return;
    const double share = jet.b0_m / b * det::exp(-r2);
    for (int j = 0; j < 3; ++j) wind_W[j] += share * jet.velocity_W[j];
}

}  // namespace hil::sim
