#include "tunnel_rotors.hpp"

#include <cmath>

#include "detmath.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kSoft = 0.1;         // e
constexpr double kBendPerStep = 0.5;  // distances to the bend of a rotor's thrust
constexpr double kFall_mps2 = 10.0;

RotorsParams without_descent(RotorsParams p) {
    p.air.descent_loss = 0.0;  // J < 0 has its own extension
    return p;
}

}  // namespace

TunnelRotors::TunnelRotors(const RotorsParams &rotors, const TunnelParams &tunnel)
    : FlowRotors(without_descent(rotors)), t_(tunnel) {}

void TunnelRotors::prepare(const StepTimes &times, const Inertia &inertia) {
    Rotors::prepare(times, inertia);
    const double mobility = mobility_per_kg(inertia);
    const double per = det::kPi / p_.air.radius_m, k = p_.thrust_coefficient_n_per_radps2;
    damping_per_s_ += k * per * (std::fabs(t_.thrust_slope) + kSoft * std::fabs(t_.thrust_bend)) * p_.max_speed_radps * mobility;
    edge_per_m_ = 2.0 * k * per * per * std::fabs(t_.thrust_bend) * mobility;
}

double TunnelRotors::longest_step(const double *s, const double *wind_W, double longest_s) const {
    double step = Rotors::longest_step(s, wind_W, longest_s);
    double turning2 = 0.0, through2 = 0.0, slowest = command_[0] + lag_[0];
    for (int j = 0; j < 3; ++j) {
        const double through = s[kV + j] - wind_W[j];
        turning2 += s[kW + j] * s[kW + j];
        through2 += through * through;
    }
    for (int i = 1; i < p_.count; ++i) slowest = std::fmin(slowest, command_[i] + lag_[i]);
    double rate = std::sqrt(turning2 * through2) + kFall_mps2;
    if (tilting_) rate += tilt_rate_radps() * std::sqrt(through2);
    const double soft = kSoft * p_.air.radius_m / det::kPi;
    if (step * rate <= kBendPerStep * soft * slowest) return step;
    double R[9], air[3];
    rotation_matrix(s + kQ, R);
    air_velocity(R, s, wind_W, air);
    for (int i = 0; i < p_.count; ++i) {
        const double *n = p_.axis[i];
        double hub[3];
        hub_velocity(i, air, s + kW, hub);
        const double along = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2], width = soft * (command_[i] + lag_[i]);
        const double distance = std::sqrt(along * along + width * width);
        if (step * rate > kBendPerStep * distance) step = kBendPerStep * distance / rate;
    }
    return step;
}

void TunnelRotors::evaluate(const Instant &now) const {
    const double *w = now.s + kW, *R = now.R;
    const double per = det::kPi / p_.air.radius_m, ratio = t_.density_ratio * now.density_ratio;
    double power = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i], *n = p_.axis[i];
        const double speed = speed_[i], k = ratio * thrust_left_[i] * p_.thrust_coefficient_n_per_radps2;
        double hub[3], across[3];
        hub_velocity(i, now.air_B, w, hub);
        const double along = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2];
        for (int j = 0; j < 3; ++j) across[j] = hub[j] - along * n[j];
        double still = speed * (speed - p_.coaxial_loss[i] * speed_[p_.above[i]]);
        if (p_.air.ground_floor > 0.0) {
            const double across2 = (across[0] * across[0] + across[1] * across[1]) + across[2] * across[2];
            const double height = now.s[kP + 2] + ((R[6] * r[0] + R[7] * r[1]) + R[8] * r[2]);
            const double up = (R[6] * n[0] + R[7] * n[1]) + R[8] * n[2];
            still *= ground_ratio(p_.air, height, up, p_.air.kappa_m2 * speed * speed, across2);
        }
        const double U = per * along;
        const double bent = U * std::sqrt(U * U + kSoft * kSoft * (speed * speed));
        const double thrust = k * (still + t_.thrust_slope * (U * speed) + t_.thrust_bend * bent);
        const double drag = ratio * p_.drag_kg_per_rad * speed;
        for (int j = 0; j < 3; ++j) force_[i][j] = thrust * n[j] - drag * across[j];
        torque_[i] = p_.moment_ratio_m * k *
                     (speed * speed + t_.torque_slope * (U * speed) + t_.torque_bend * (U * U));
        power += torque_[i] * speed;
    }
    power_w_ = power;
}

void TunnelRotors::assemble(const Instant &now, Wrench &out) const {
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i], *f = force_[i];
        const double reaction = p_.spin[i] * torque_[i];
        const double moment[3] = {r[1] * f[2] - r[2] * f[1], r[2] * f[0] - r[0] * f[2], r[0] * f[1] - r[1] * f[0]};
        for (int j = 0; j < 3; ++j) {
            out.force_B[j] += f[j];
            out.torque_B[j] += moment[j] - reaction * p_.axis[i][j];
        }
    }
    if (now.slipstreams) publish_all(now);
    if (imbalanced_) add_imbalance(out);
    add_gyroscopic(now.s + kW, out);
}

}  // namespace hil::sim
