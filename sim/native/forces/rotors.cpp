#include "rotors.hpp"

#include <cmath>

#include "battery.hpp"
#include "blade_rotors.hpp"
#include "detmath.hpp"
#include "downwash.hpp"
#include "force_binding.hpp"
#include "rotor_bindings.hpp"
#include "rotation.hpp"
#include "slipstream.hpp"

namespace hil::sim {

namespace {

constexpr double kLeastAcross = 1e-9;  // part of an axis across x, below which it is along x
constexpr double kLagsPerStep = 2.0;   // motor time constants
constexpr double kCalm2 = 0.09;        // (m/s)^2, keeps the slipstream smooth at rest
constexpr double kWhirlPerStep = 1.0;  // rad of an unbalanced rotor
constexpr double kPolePerStep = 0.4;   // distances to the nearest pole of a rotor's thrust

}  // namespace

Rotors::Rotors(const RotorsParams &params) : p_(params) {
    for (int i = 0; i < p_.count; ++i) {
        const double *n = p_.axis[i];
        double *e1 = plane_[i][0], *e2 = plane_[i][1];
        const double across = std::sqrt(n[1] * n[1] + n[2] * n[2]);
        const bool along_x = !(across > kLeastAcross);
        for (int j = 0; j < 3; ++j) {
            e1[j] = along_x ? (j == 2 ? 1.0 : 0.0) : ((j == 0 ? 1.0 : 0.0) - n[0] * n[j]) / across;
        }
        e2[0] = n[1] * e1[2] - n[2] * e1[1];
        e2[1] = n[2] * e1[0] - n[0] * e1[2];
        e2[2] = n[0] * e1[1] - n[1] * e1[0];
        if (n[0] != 0.0 || n[1] != 0.0 || n[2] != 1.0 || p_.coaxial_loss[i] != 0.0) upright_ = false;
    }
    repair();
}

void Rotors::repair() {
    for (int i = 0; i < p_.count; ++i) {
        set_rotor(i, 1.0, -1.0, 0.0);
        phase_[i] = 0.0;
    }
}

void Rotors::set_rotor(int rotor, double thrust_left, double forced_speed_radps, double imbalance_kgm) {
    thrust_left_[rotor] = thrust_left;
    forced_speed_radps_[rotor] = forced_speed_radps;
    imbalance_kgm_[rotor] = imbalance_kgm;
    imbalanced_ = false;
    for (int i = 0; i < p_.count; ++i) imbalanced_ = imbalanced_ || imbalance_kgm_[i] > 0.0;
}

RotorPose Rotors::let_tilt(int rotor, double reach_m) {
    if (!tilting_) {
        for (int i = 0; i < p_.count; ++i) {
            const double *r = p_.position_m[i];
            reach_m_[i] = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
        }
    }
    tilting_ = true;
    upright_ = false;
    reach_m_[rotor] = reach_m;
    RotorPose pose{};
    for (int j = 0; j < 3; ++j) {
        pose.place_m[j] = p_.position_m[rotor][j];
        pose.axis[j] = p_.axis[rotor][j];
        for (int k = 0; k < 2; ++k) pose.plane[k][j] = plane_[rotor][k][j];
    }
    return pose;
}

void Rotors::turn(int rotor, const RotorPose &pose) {
    tilt_rate_[rotor] = pose.tilt_rate_radps;
    for (int j = 0; j < 3; ++j) {
        p_.position_m[rotor][j] = pose.place_m[j];
        p_.axis[rotor][j] = pose.axis[j];
        place_rate_[rotor][j] = pose.place_rate_mps[j];
        axis_rate_[rotor][j] = pose.axis_rate_per_s[j];
        for (int k = 0; k < 2; ++k) plane_[rotor][k][j] = pose.plane[k][j];
    }
}

double Rotors::tilt_rate_radps() const {
    double most = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double rate = std::fabs(tilt_rate_[i]);
        if (rate > most) most = rate;
    }
    return most;
}

double Rotors::mobility_per_kg(const Inertia &inertia) const {
    double reach2 = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i];
        reach2 += tilting_ ? reach_m_[i] * reach_m_[i] : r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
    }
    return p_.count / inertia.mass_kg + reach2 / inertia.least_kgm2();
}

Rotors::Decay Rotors::decay_over(double dt_s) const {
    const double up = det::exp(-dt_s / p_.time_constant_up_s);
    const bool same = p_.time_constant_down_s == p_.time_constant_up_s;
    return {up, same ? up : det::exp(-dt_s / p_.time_constant_down_s)};
}

const Rotors::Decay &Rotors::decay_at(int level, int node) {
    if (!filled_[level]) [[unlikely]] {
        filled_[level] = true;
        for (int n = 0; n < nodes_; ++n) node_[level][n] = decay_over(times_.node(n) * times_.step_s(level));
    }
    return node_[level][node];
}

void Rotors::prepare(const StepTimes &times, const Inertia &inertia) {
    const double drag = p_.drag_kg_per_rad + p_.air.axial_kg_per_rad;
    damping_per_s_ = drag * p_.max_speed_radps * mobility_per_kg(inertia) +
                     p_.count * p_.inertia_kgm2 * p_.max_speed_radps / inertia.least_kgm2();
    lag_rate_per_s_ = 1.0 / (kLagsPerStep * std::fmin(p_.time_constant_up_s, p_.time_constant_down_s));
    nodes_ = times.nodes();
    times_ = times;
    for (bool &filled : filled_) filled = false;
    for (int hard = 0; hard < kContactKinds; ++hard) {
        contact_s_[hard] = times.contact_s(hard);
        contact_[hard] = decay_over(contact_s_[hard]);
    }
    tick_s_ = times.tick_s;
    tick_ = decay_over(tick_s_);
}

int Rotors::command(const double *control, double voltage) {
    const double full = p_.voltage_slope == 1.0 ? voltage : 1.0 + p_.voltage_slope * (voltage - 1.0);
    for (int i = 0; i < p_.count; ++i) {
        if (!std::isfinite(control[i])) return i;
        if (forced_speed_radps_[i] >= 0.0) {
            command_[i] = forced_speed_radps_[i];
            continue;
        }
        const double u = control[i] < 0.0 ? 0.0 : (control[i] > 1.0 ? 1.0 : control[i]);
        const double f = p_.thrust_model_factor;
        const double relative = f == 1.0 ? u : std::sqrt(f * (u * u) + (1.0 - f) * u);
        command_[i] = relative * p_.max_speed_radps * full;
    }
    return -1;
}

void Rotors::settle(double *own) const {
    for (int i = 0; i < p_.count; ++i) own[i] = command_[i];
}

void Rotors::begin_tick(const double *own) {
    fastest_ = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        lag_[i] = own[i] - command_[i];
        up_[i] = lag_[i] < 0.0;
        rate_[i] = -1.0 / tau_s(up_[i]);
        if (imbalanced_ && imbalance_kgm_[i] > 0.0) {
            const double most = up_[i] ? command_[i] : own[i];
            if (most > fastest_) fastest_ = most;
        }
    }
}

void Rotors::end_tick(double *own) {
    for (int i = 0; i < p_.count; ++i) own[i] = command_[i] + lag_[i];
}

double Rotors::step_rate_per_s(bool classical) const {
    const double whirl = fastest_ / kWhirlPerStep;
    return classical || whirl > lag_rate_per_s_ ? whirl : lag_rate_per_s_;
}

// The poles lie in the complex plane of the rotor's speed at radius a / (x0 sqrt(kappa)), 45 degrees off the axes, for
// the descent into the own wake, and at +-i V / sqrt(kappa) for the speed V across the rotor. Both are at least
// O / sqrt(2) away.
double Rotors::longest_step(const double *s, const double *wind_W, double longest_s) const {
    if (!(p_.air.kappa_m2 > 0.0 && (p_.air.descent_loss > 0.0 || p_.air.ground_floor > 0.0))) return longest_s;
    bool far = true;
    for (int i = 0; i < p_.count; ++i) {
        const double change = std::fabs(rate_[i] * lag_[i]) * longest_s;
        if (change * 1.5 > kPolePerStep * (command_[i] + lag_[i])) far = false;
    }
    if (far) return longest_s;
    double R[9], air[3];
    rotation_matrix(s + kQ, R);
    air_velocity(R, s, wind_W, air);
    double step = longest_s;
    for (int i = 0; i < p_.count; ++i) {
        double hub[3];
        hub_velocity(i, air, s + kW, hub);
        if (!upright_) {  // into the axes e1, e2, n
            const double *rows[3] = {plane_[i][0], plane_[i][1], p_.axis[i]};
            const double b[3] = {hub[0], hub[1], hub[2]};
            for (int j = 0; j < 3; ++j) hub[j] = (rows[j][0] * b[0] + rows[j][1] * b[1]) + rows[j][2] * b[2];
        }
        const double speed = command_[i] + lag_[i];
        const double rate = std::fabs(rate_[i] * lag_[i]);
        const double ring = hub[2] < 0.0 ? -hub[2] / kVortexRingCentre : 0.0;
        const double across2 = (hub[0] * hub[0] + hub[1] * hub[1]) / p_.air.kappa_m2;
        const double aside = ring * std::sqrt(0.5 / p_.air.kappa_m2);
        const double along = speed - aside;
        const double ring2 = along * along + aside * aside, across = speed * speed + across2;
        const double distance = std::sqrt(ring2 < across ? ring2 : across);
        if (step * rate > kPolePerStep * distance) step = kPolePerStep * distance / rate;
    }
    return step;
}

void Rotors::at(int level, int node, double t_s) {
    const Decay d = decay_at(level, node);
    for (int i = 0; i < p_.count; ++i) {
        const double lag_now = lag_[i] * (up_[i] ? d.up : d.down);
        speed_[i] = command_[i] + lag_now;
        accel_[i] = rate_[i] * lag_now;
        if (imbalanced_) push(i, t_s, lag_now);
    }
}

void Rotors::push(int i, double t_s, double lag_now) {
    const double b = imbalance_kgm_[i];
    push_x_[i] = push_y_[i] = 0.0;
    if (!(b > 0.0)) return;
    const double pull = b * (speed_[i] * speed_[i]);
    const double angle = phase_at(i, t_s, lag_now);
    push_x_[i] = pull * det::cos(angle);
    push_y_[i] = pull * det::sin(angle);
}

// phi + s int O dt,  int O dt = c t + tau (l(0) - l(t))
double Rotors::phase_at(int i, double t_s, double lag_now) const {
    return phase_[i] + p_.spin[i] * (command_[i] * t_s - (lag_[i] - lag_now) / rate_[i]);
}

void Rotors::end_step(int level, double h_s) {
    const Decay d = decay_at(level, nodes_ - 1);
    for (int i = 0; i < p_.count; ++i) {
        const double lag_now = lag_[i] * (up_[i] ? d.up : d.down);
        if (imbalanced_) {
            const double angle = phase_at(i, h_s, lag_now);
            phase_[i] = angle - 2.0 * det::kPi * std::floor(angle / (2.0 * det::kPi));
        }
        lag_[i] = lag_now;
    }
}

void Rotors::assemble(const Instant &now, Wrench &out) const {
    if (now.slipstreams) publish_all(now);
    if (upright_) {
        add_upright(now, out);
    } else {
        add_tilted(now, out);
    }
}

void Rotors::publish_all(const Instant &now) const {
    const double *a = now.air_B;
    const double half = 0.5 * std::sqrt(((a[0] * a[0] + a[1] * a[1]) + a[2] * a[2]) + kCalm2);
    for (int i = 0; i < p_.count; ++i) {
        const double hover2 = p_.air.kappa_m2 * (speed_[i] * speed_[i]);
        publish(i, hover2 / (half + std::sqrt(half * half + hover2)), now);
    }
}

void Rotors::publish(int i, double induced_mps, const Instant &now) const {
    Slipstream &out = now.slipstreams->of[now.slipstreams->count++];
    const double *n = p_.axis[i];
    double hub[3];
    hub_velocity(i, now.air_B, now.s + kW, hub);
    for (int j = 0; j < 3; ++j) {
        out.place_m[j] = p_.position_m[i][j];
        out.axis[j] = n[j];
    }
    out.radius_m = p_.air.radius_m;
    out.induced_mps = induced_mps;
    out.rate_mps2 = std::fabs(accel_[i]) * std::sqrt(p_.air.kappa_m2);
    out.axial_mps = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2];
    const double across2 = ((hub[0] * hub[0] + hub[1] * hub[1]) + hub[2] * hub[2]) - out.axial_mps * out.axial_mps;
    out.across2 = across2 > 0.0 ? across2 : 0.0;
}

void Rotors::add_upright(const Instant &now, Wrench &out) const {
    const double *w = now.s + kW, *R = now.R;
    double force[3], torque[3];
    for (int j = 0; j < 3; ++j) {
        force[j] = out.force_B[j];
        torque[j] = out.torque_B[j];
    }
    const bool near_ground = p_.air.ground_floor > 0.0, descends = p_.air.descent_loss > 0.0;
    double spin_momentum = 0.0, spin_momentum_rate = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i];
        const double speed = speed_[i];
        const double speed2 = speed * speed;
        const double static_thrust = p_.thrust_coefficient_n_per_radps2 * thrust_left_[i] * speed2;
        const double drag = p_.drag_kg_per_rad * speed;
        double hub[3];
        point_velocity(now.air_B, w, r, hub);
        double thrust = static_thrust;
        if (near_ground || descends) {
            const double induced2 = p_.air.kappa_m2 * speed2;
            const double across2 = hub[0] * hub[0] + hub[1] * hub[1];
            if (near_ground) {
                const double height = now.s[kP + 2] + ((R[6] * r[0] + R[7] * r[1]) + R[8] * r[2]);
                thrust *= ground_ratio(p_.air, height, R[8], induced2, across2);
            }
            if (descends) thrust *= descent_ratio(p_.air, hub[2], induced2, across2);
        }
        thrust -= p_.air.axial_kg_per_rad * speed * hub[2];
        double fx = -drag * hub[0], fy = -drag * hub[1];
        if (imbalanced_) {
            fx += push_x_[i];
            fy += push_y_[i];
        }
        force[0] += fx;
        force[1] += fy;
        force[2] += thrust;
        torque[0] += r[1] * thrust - r[2] * fy;
        torque[1] += r[2] * fx - r[0] * thrust;
        torque[2] += (r[0] * fy - r[1] * fx) - p_.spin[i] * p_.moment_ratio_m * static_thrust;
        spin_momentum += p_.spin[i] * p_.inertia_kgm2 * speed;
        spin_momentum_rate += p_.spin[i] * p_.inertia_kgm2 * accel_[i];
    }
    torque[0] -= w[1] * spin_momentum;
    torque[1] += w[0] * spin_momentum;
    torque[2] -= spin_momentum_rate;
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] = force[j];
        out.torque_B[j] = torque[j];
    }
}

// The same for rotors with axes of their own and coaxial pairs.
void Rotors::add_tilted(const Instant &now, Wrench &out) const {
    const double *w = now.s + kW, *R = now.R;
    double *force = out.force_B, *torque = out.torque_B, h[3] = {0.0, 0.0, 0.0};
    const bool near_ground = p_.air.ground_floor > 0.0, descends = p_.air.descent_loss > 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i], *n = p_.axis[i];
        const double speed = speed_[i];
        const double k = p_.thrust_coefficient_n_per_radps2 * thrust_left_[i];
        double hub[3], across[3];
        hub_velocity(i, now.air_B, w, hub);
        const double axial = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2];
        for (int j = 0; j < 3; ++j) across[j] = hub[j] - axial * n[j];
        double thrust = k * speed * (speed - p_.coaxial_loss[i] * speed_[p_.above[i]]);
        if (near_ground || descends) {
            const double induced2 = p_.air.kappa_m2 * (speed * speed);
            const double across2 = (across[0] * across[0] + across[1] * across[1]) + across[2] * across[2];
            if (near_ground) {
                const double height = now.s[kP + 2] + ((R[6] * r[0] + R[7] * r[1]) + R[8] * r[2]);
                const double up = (R[6] * n[0] + R[7] * n[1]) + R[8] * n[2];
                thrust *= ground_ratio(p_.air, height, up, induced2, across2);
            }
            if (descends) thrust *= descent_ratio(p_.air, axial, induced2, across2);
        }
        thrust -= p_.air.axial_kg_per_rad * speed * axial;
        const double drag = p_.drag_kg_per_rad * speed;
        const double reaction = p_.spin[i] * p_.moment_ratio_m * (k * (speed * speed));
        const double momentum = p_.spin[i] * p_.inertia_kgm2 * speed;
        const double momentum_rate = p_.spin[i] * p_.inertia_kgm2 * accel_[i];
        double f[3];
        for (int j = 0; j < 3; ++j) {
            f[j] = thrust * n[j] - drag * across[j];
            if (imbalanced_) f[j] += push_x_[i] * plane_[i][0][j] + push_y_[i] * plane_[i][1][j];
            force[j] += f[j];
            torque[j] -= (reaction + momentum_rate) * n[j];
            h[j] += momentum * n[j];
            if (tilting_) torque[j] -= momentum * axis_rate_[i][j];
        }
        torque[0] += r[1] * f[2] - r[2] * f[1];
        torque[1] += r[2] * f[0] - r[0] * f[2];
        torque[2] += r[0] * f[1] - r[1] * f[0];
    }
    torque[0] -= w[1] * h[2] - w[2] * h[1];
    torque[1] -= w[2] * h[0] - w[0] * h[2];
    torque[2] -= w[0] * h[1] - w[1] * h[0];
}

void Rotors::add_imbalance(Wrench &out) const {
    for (int i = 0; i < p_.count; ++i) {
        const double *r = p_.position_m[i];
        double f[3];
        for (int j = 0; j < 3; ++j) {
            f[j] = push_x_[i] * plane_[i][0][j] + push_y_[i] * plane_[i][1][j];
            out.force_B[j] += f[j];
        }
        out.torque_B[0] += r[1] * f[2] - r[2] * f[1];
        out.torque_B[1] += r[2] * f[0] - r[0] * f[2];
        out.torque_B[2] += r[0] * f[1] - r[1] * f[0];
    }
}

void Rotors::add_gyroscopic(const double *w, Wrench &out) const {
    double h[3] = {0.0, 0.0, 0.0}, rate[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < p_.count; ++i) {
        const double along = p_.spin[i] * p_.inertia_kgm2;
        for (int j = 0; j < 3; ++j) {
            h[j] += along * speed_[i] * p_.axis[i][j];
            rate[j] += along * accel_[i] * p_.axis[i][j];
            if (tilting_) rate[j] += along * speed_[i] * axis_rate_[i][j];
        }
    }
    out.torque_B[0] -= (w[1] * h[2] - w[2] * h[1]) + rate[0];
    out.torque_B[1] -= (w[2] * h[0] - w[0] * h[2]) + rate[1];
    out.torque_B[2] -= (w[0] * h[1] - w[1] * h[0]) + rate[2];
}

void Rotors::at_contact(const double *own, bool hard) {
    const Decay d = contact_[hard];
    for (int i = 0; i < p_.count; ++i) {
        const double lag = own[i] - command_[i];
        speed_[i] = own[i];
        accel_[i] = lag * ((lag < 0.0 ? d.up : d.down) - 1.0) / contact_s_[hard];
        // The force of an unbalanced rotor averages out over a contact sub-step, and the feet hold the vehicle.
        push_x_[i] = push_y_[i] = 0.0;
    }
}

void Rotors::end_contact(double *own, bool hard) {
    const Decay d = contact_[hard];
    for (int i = 0; i < p_.count; ++i) {
        const double lag = own[i] - command_[i];
        own[i] = command_[i] + lag * (lag < 0.0 ? d.up : d.down);
    }
}

void Rotors::at_instant(const double *own) {
    for (int i = 0; i < p_.count; ++i) {
        const double lag = own[i] - command_[i];
        speed_[i] = own[i];
        accel_[i] = -lag / tau_s(lag < 0.0);
        push_x_[i] = push_y_[i] = 0.0;
    }
}

// sum m_i O_i^3
double Rotors::power_w(const Instant &, const double *own) {
    double power = 0.0;
    for (int i = 0; i < p_.count; ++i) power += thrust_left_[i] * (own[i] * own[i] * own[i]);
    return p_.moment_ratio_m * p_.thrust_coefficient_n_per_radps2 * power;
}

double Rotors::work_j(const double *own_before) const {
    double cubed = 0.0;
    for (int i = 0; i < p_.count; ++i) {
        const double lag = own_before[i] - command_[i];
        const bool up = lag < 0.0;
        cubed += thrust_left_[i] * cubed_speed_integral(command_[i], lag, tau_s(up), tick_s_, up ? tick_.up : tick_.down);
    }
    return p_.moment_ratio_m * p_.thrust_coefficient_n_per_radps2 * cubed;
}

bool Rotors::jet(const double *s, const double *own, const double *wind_W, Jet &out) const {
    double force_B[3] = {0.0, 0.0, 0.0};
    int discs = 0;
    for (int i = 0; i < p_.count; ++i) {
        const double thrust = p_.thrust_coefficient_n_per_radps2 * thrust_left_[i] * own[i] *
                              (own[i] - p_.coaxial_loss[i] * own[p_.above[i]]);
        for (int j = 0; j < 3; ++j) force_B[j] += thrust * p_.axis[i][j];
        discs += p_.above[i] == i;
    }
    const double kappa_n = p_.air.kappa_m2 / p_.thrust_coefficient_n_per_radps2;  // 1 / (2 rho pi R^2)
    return jet_of(s, force_B, kappa_n, p_.air.radius_m, discs, wind_W, out);
}

namespace {

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Rotors, Force>(m, "Rotors", "Rotors of a vehicle; see forces/rotors.hpp. Own states: their speeds.")
        .def(
            "__init__",
            [](Rotors *self, const std::vector<::Vec3> &position_m, const std::vector<double> &spin,
               const std::vector<::Vec3> &axis, const std::vector<int> &above, double coaxial_loss,
               double thrust_coefficient_n_per_radps2, double moment_ratio_m, double max_speed_radps,
               double thrust_model_factor, double time_constant_up_s, double time_constant_down_s, double inertia_kgm2,
               double drag_kg_per_rad, double axial_drag_kg_per_rad, double radius_m, double ground_thrust_ratio,
               double descent_loss, double air_density_kgpm3, double ground_radius_m, double voltage_slope) {
                const std::size_t n = position_m.size();
                if (n < 1 || n > kMaxRotors || spin.size() != n || axis.size() != n || above.size() != n) {
                    throw std::invalid_argument("1 to 8 rotors, each with position, spin, axis and rotor above");
                }
                RotorsParams p{};
                p.count = static_cast<int>(n);
                for (std::size_t i = 0; i < n; ++i) {
                    if (above[i] >= p.count) throw std::invalid_argument("a rotor above does not exist");
                    for (int j = 0; j < 3; ++j) {
                        p.position_m[i][j] = position_m[i][j];
                        p.axis[i][j] = axis[i][j];
                    }
                    p.spin[i] = spin[i];
                    p.above[i] = above[i] < 0 ? static_cast<int>(i) : above[i];
                    p.coaxial_loss[i] = above[i] < 0 ? 0.0 : coaxial_loss;
                }
                p.thrust_coefficient_n_per_radps2 = thrust_coefficient_n_per_radps2;
                p.moment_ratio_m = moment_ratio_m;
                p.max_speed_radps = max_speed_radps;
                p.thrust_model_factor = thrust_model_factor;
                p.time_constant_up_s = time_constant_up_s;
                p.time_constant_down_s = time_constant_down_s;
                p.inertia_kgm2 = inertia_kgm2;
                p.drag_kg_per_rad = drag_kg_per_rad;
                p.voltage_slope = voltage_slope;
                const double disc_m2 = det::kPi * radius_m * radius_m;
                p.air = {thrust_coefficient_n_per_radps2 / (2.0 * air_density_kgpm3 * disc_m2), radius_m,
                         ground_thrust_ratio > 1.0 ? ground_thrust_ratio / (ground_thrust_ratio - 1.0) : 0.0,
                         descent_loss, axial_drag_kg_per_rad, ground_radius_m > 0.0 ? ground_radius_m : radius_m};
                new (self) Rotors(p);
            },
            nb::kw_only(), "position_m"_a, "spin"_a, "axis"_a, "above"_a, "coaxial_loss"_a,
            "thrust_coefficient_n_per_radps2"_a, "moment_ratio_m"_a, "max_speed_radps"_a, "thrust_model_factor"_a,
            "time_constant_up_s"_a, "time_constant_down_s"_a, "inertia_kgm2"_a, "drag_kg_per_rad"_a,
            "axial_drag_kg_per_rad"_a, "radius_m"_a, "ground_thrust_ratio"_a, "descent_loss"_a,
            "air_density_kgpm3"_a = 1.225, "ground_radius_m"_a = 0.0, "voltage_slope"_a = 1.0)
        .def(
            "set_rotor",
            [](Rotors &self, int rotor, double thrust_left, double forced_speed_radps, double imbalance_kgm) {
                if (rotor < 0 || rotor >= self.states()) throw nb::index_error("rotor index is out of range");
                self.set_rotor(rotor, thrust_left, forced_speed_radps, imbalance_kgm);
            },
            "rotor"_a, "thrust_left"_a, "forced_speed_radps"_a, "imbalance_kgm"_a,
            "Set the state of a rotor from the next tick on; with a forced speed < 0 it follows its command.")
        .def(
            "set_driven",
            [](Rotors &self, int rotor, bool driven) {
                if (rotor < 0 || rotor >= self.states()) throw nb::index_error("rotor index is out of range");
                if (!self.set_driven(rotor, driven)) throw std::invalid_argument("these rotors have no motors");
            },
            "rotor"_a, "driven"_a, "Let a rotor's motor be driven, or not, from the next tick on.");

    nb::class_<BladeRotors, Rotors>(m, "BladeRotors",
                                    "Rotors by blade-element momentum theory; see forces/blade_rotors.hpp.")
        .def(
            "__init__",
            [](BladeRotors *self, const Rotors &rotors, double inflow_thrust_kg_per_rad,
               double translational_thrust_kg_per_m, double induced_power_factor, double profile_power_growth,
               double hub_moment_share, double ground_floor, double density_ratio, double coaxial_wake) {
                new (self) BladeRotors(rotors.params(), {inflow_thrust_kg_per_rad, translational_thrust_kg_per_m,
                                                         induced_power_factor, profile_power_growth, hub_moment_share,
                                                         ground_floor, density_ratio, coaxial_wake});
            },
            "rotors"_a, nb::kw_only(), "inflow_thrust_kg_per_rad"_a, "translational_thrust_kg_per_m"_a,
            "induced_power_factor"_a, "profile_power_growth"_a, "hub_moment_share"_a, "ground_floor"_a,
            "density_ratio"_a, "coaxial_wake"_a, "The rotors of `rotors`, with these blades; see BladeParams.")
        .def_prop_ro(
            "induced_mps",
            [](const BladeRotors &self) {
                nb::list out;
                for (int i = 0; i < self.states(); ++i) out.append(self.induced_mps(i));
                return nb::tuple(out);
            },
            "Induced velocity aloft of each rotor where the forces were computed last [m/s].")
        .def_prop_ro(
            "torque_nm",
            [](const BladeRotors &self) {
                nb::list out;
                for (int i = 0; i < self.states(); ++i) out.append(self.torque_nm(i));
                return nb::tuple(out);
            },
            "Shaft torque of each rotor against its spin, there [N m].");
    bind_motor_rotors(m);
}};

}  // namespace

}  // namespace hil::sim
