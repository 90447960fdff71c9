#include "downwash.hpp"

#include <cmath>

#include "detmath.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kSpread = 0.107;   // db/dz
constexpr double kEdge2 = 9.0;      // (r / b)^2 at which the jet ends

double length(const double *v) { return std::sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]); }

}  // namespace

Jet jet_of(const RigidBodyParams &params, const double *state, const double *wind_W) {
    double force_B[3] = {0.0, 0.0, 0.0};
    int discs = 0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double speed = state[kPoseVelocity + i], above = state[kPoseVelocity + params.rotor_above[i]];
        const double thrust = params.thrust_coefficient_n_per_radps2 * params.thrust_left[i] * speed *
                              (speed - params.coaxial_loss[i] * above);
        for (int j = 0; j < 3; ++j) force_B[j] += thrust * params.rotor_axis[i][j];
        discs += params.rotor_above[i] == i;
    }
    Jet jet{};
    const double thrust = length(force_B);
    if (!(thrust > 0.0)) return jet;
    const double kappa_n = params.air.kappa_m2 / params.thrust_coefficient_n_per_radps2;  // 1 / (2 rho pi R^2)
    const double far_wake = 2.0 * std::sqrt(kappa_n * thrust / discs);
    double force_W[3];
    rotate_into_world(state + kQ, force_B, force_W);
    for (int j = 0; j < 3; ++j) {
        jet.origin_W[j] = state[kP + j];
        jet.velocity_W[j] = -far_wake / thrust * force_W[j];
        jet.axis_W[j] = jet.velocity_W[j] - (state[kV + j] - wind_W[j]);
    }
    const double speed = length(jet.axis_W);
    if (!(speed > 1e-6 * far_wake)) return jet;  // the vehicle falls into its own wake
    for (int j = 0; j < 3; ++j) jet.axis_W[j] /= speed;
    jet.b0_m = params.air.radius_m * std::sqrt(static_cast<double>(discs));
    return jet;
}

void add_jet(const Jet &jet, const double *p_W, double *wind_W) {
    if (!(jet.b0_m > 0.0)) return;
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
