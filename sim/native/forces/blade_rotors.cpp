#include "blade_rotors.hpp"

#include <cmath>

#include "detmath.hpp"
#include "rotation.hpp"
#include "slipstream.hpp"

namespace hil::sim {

namespace {

constexpr double kPolePerStep = 0.3;  // distances to the nearest singularity of a rotor's inflow

int padded(int lanes) { return (lanes + 3) / 4 * 4; }

}  // namespace

BladeRotors::BladeRotors(const RotorsParams &rotors, const BladeParams &blades)
    : FlowRotors(rotors), b_(blades), kernel_(blade_kernel()) {
    BladeLanes &l = lanes_;
    int uppers = 0, lowers = 0;
    for (int i = 0; i < p_.count; ++i) uppers += p_.above[i] == i;
    l.uppers = padded(uppers);
    l.lanes = l.uppers + padded(p_.count - uppers);
    uppers = 0;
    for (int i = 0; i < p_.count; ++i) lane_[i] = p_.above[i] == i ? uppers++ : l.uppers + lowers++;
    for (int at = 0; at < kBladeLanes; ++at) l.above[at] = 0;
    l.radius_m = p_.air.radius_m;
    l.k_d = p_.drag_kg_per_rad;
    l.induced_power_factor = b_.induced_power_factor;
    l.profile_power_growth = b_.profile_power_growth;
    l.hub_moment_share = b_.hub_moment_share;
    l.ground_floor = b_.ground_floor;
    l.ground_radius_m = p_.air.ground_radius_m;
    for (int i = 0; i < p_.count; ++i) {
        const int at = lane_[i];
        for (int j = 0; j < 3; ++j) {
            l.r[j][at] = p_.position_m[i][j];
            l.n[j][at] = p_.axis[i][j];
        }
        l.spin[at] = p_.spin[i];
        l.above[at] = lane_[p_.above[i]];
        l.wake[at] = p_.above[i] == i ? 0.0 : b_.coaxial_wake;
    }
    repair();
}

void BladeRotors::set_rotor(int rotor, double thrust_left, double forced_speed_radps, double imbalance_kgm) {
    Rotors::set_rotor(rotor, thrust_left, forced_speed_radps, imbalance_kgm);
    BladeLanes &l = lanes_;
    const int at = lane_[rotor];
    const double radius = p_.air.radius_m;
    const double disc = p_.thrust_coefficient_n_per_radps2 / p_.air.kappa_m2;  // 2 rho A
    const double k = thrust_left * p_.thrust_coefficient_n_per_radps2, c_l = thrust_left * b_.inflow_thrust_kg_per_rad;
    const double kappa = k / disc, per_speed = std::sqrt(kappa);
    l.c_t[at] = k + c_l * per_speed;
    l.c_l[at] = c_l;
    l.c_v[at] = b_.translational_thrust_kg_per_m < 0.0 ? 1.5 * l.c_t[at] / (radius * radius)
                                                       : thrust_left * b_.translational_thrust_kg_per_m;
    l.c_q[at] = k * (p_.moment_ratio_m - b_.induced_power_factor * per_speed);
    l.kappa[at] = kappa;
    l.t_disc[at] = l.c_t[at] / disc;
    l.l_disc[at] = l.c_l[at] / disc;
    l.v_disc[at] = l.c_v[at] / disc;
}

void BladeRotors::turn(int rotor, const RotorPose &pose) {
    Rotors::turn(rotor, pose);
    const int at = lane_[rotor];
    lanes_.drifts = true;
    for (int j = 0; j < 3; ++j) {
        lanes_.r[j][at] = pose.place_m[j];
        lanes_.n[j][at] = pose.axis[j];
        lanes_.drift[j][at] = pose.place_rate_mps[j];
    }
}

void BladeRotors::prepare(const StepTimes &times, const Inertia &inertia) {
    Rotors::prepare(times, inertia);
    const double mobility = mobility_per_kg(inertia);
    const double radius2 = p_.air.radius_m * p_.air.radius_m;
    damping_per_s_ += (lanes_.c_l[0] + 2.0 * lanes_.c_q[0] / radius2) * p_.max_speed_radps * mobility;
    edge_per_m_ = 2.0 * lanes_.c_v[0] * mobility;
}

double BladeRotors::longest_step(const double *s, const double *wind_W, double longest_s) const {
    bool far = true;
    // A turning body changes u_n by |w| |u|, which counts as a change of speed by 0.5 / sqrt(kappa) of it.
    double turning2 = 0.0, through2 = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double through = s[kV + j] - wind_W[j];
        turning2 += s[kW + j] * s[kW + j];
        through2 += through * through;
    }
    const double per = 1.0 / std::sqrt(p_.air.kappa_m2);
    double turned = 0.5 * per * std::sqrt(turning2 * through2);
    if (tilting_) turned += 0.5 * per * tilt_rate_radps() * std::sqrt(through2);
    for (int i = 0; i < p_.count; ++i) {
        const double change = (std::fabs(rate_[i] * lag_[i]) + turned) * longest_s;
        // Without descent the nearest singularity is at least |O| away; in it, a tenth of that.
        if (change > 0.1 * kPolePerStep * (command_[i] + lag_[i])) far = false;
    }
    if (far) return longest_s;
    double R[9], air[3];
    rotation_matrix(s + kQ, R);
    air_velocity(R, s, wind_W, air);
    double step = longest_s;
    for (int i = 0; i < p_.count; ++i) {
        const double *n = p_.axis[i];
        double hub[3];
        hub_velocity(i, air, s + kW, hub);
        const double along = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2];
        const double all2 = (hub[0] * hub[0] + hub[1] * hub[1]) + hub[2] * hub[2];
        const double rest = all2 - along * along, across2 = rest > 0.0 ? rest : 0.0;
        const double speed = command_[i] + lag_[i];
        double rate = std::fabs(rate_[i] * lag_[i]);
        const double edge2 = across2 / (p_.air.radius_m * p_.air.radius_m), flow2 = all2 / p_.air.kappa_m2;
        double distance2 = speed * speed + (edge2 < flow2 ? edge2 : flow2);
        if (along < 0.0) {
            rate += turned;
            const double ahead = speed + 0.5 * along * per;
            const double aside = (0.2 * std::sqrt(across2) - 0.05 * along) * per;
            const double ring2 = ahead * ahead + aside * aside;
            if (ring2 < distance2) distance2 = ring2;
        }
        const double distance = std::sqrt(distance2);
        if (step * rate > kPolePerStep * distance) step = kPolePerStep * distance / rate;
    }
    return step;
}

void BladeRotors::evaluate(const Instant &now) const {
    BladeLanes &l = lanes_;
    for (int i = 0; i < p_.count; ++i) l.speed[lane_[i]] = speed_[i];
    for (int j = 0; j < 3; ++j) {
        l.air_B[j] = now.air_B[j];
        l.w[j] = now.s[kW + j];
        l.up_B[j] = now.R[6 + j];
    }
    l.height_m = now.s[kP + 2];
    l.density_ratio = b_.density_ratio * now.density_ratio;
    kernel_.loads(l);
    double power = 0.0;
    for (int i = 0; i < p_.count; ++i) power += l.torque[lane_[i]] * speed_[i];
    power_w_ = power;
}

void BladeRotors::assemble(const Instant &now, Wrench &out) const {
    const BladeLanes &l = lanes_;
    double force[3] = {0.0, 0.0, 0.0}, torque[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < p_.count; ++i) {
        const int at = lane_[i];
        const double reaction = p_.spin[i] * l.torque[at];
        for (int j = 0; j < 3; ++j) {
            force[j] += l.force[j][at];
            torque[j] += l.moment[j][at] - reaction * p_.axis[i][j];
        }
    }
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] += force[j];
        out.torque_B[j] += torque[j];
    }
    if (now.slipstreams) {
        for (int i = 0; i < p_.count; ++i) publish(i, l.induced[lane_[i]], now);
    }
    if (imbalanced_) add_imbalance(out);
    add_gyroscopic(now.s + kW, out);
}

}  // namespace hil::sim
