#include "rigid_body.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

namespace {

constexpr int kP = 0, kQ = 3, kV = 7, kW = 10;

void normalise_quaternion(double *q) {
    const double s = 1.0 / std::sqrt((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]));
    for (int i = 0; i < 4; ++i) q[i] *= s;
}

// R(q / |q|), row major. RK stages leave the unit sphere by O(h^2); dividing by |q|^2 keeps R a rotation there.
void rotation(const double *q, double R[9]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double s = 2.0 / ((w * w + x * x) + (y * y + z * z));
    R[0] = 1.0 - s * (y * y + z * z);
    R[1] = s * (x * y - w * z);
    R[2] = s * (x * z + w * y);
    R[3] = s * (x * y + w * z);
    R[4] = 1.0 - s * (x * x + z * z);
    R[5] = s * (y * z - w * x);
    R[6] = s * (x * z - w * y);
    R[7] = s * (y * z + w * x);
    R[8] = 1.0 - s * (x * x + y * y);
}

void multiply_quaternion(const double *a, const double *b, double *c) {
    c[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    c[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    c[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    c[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

double rotor_command(const RigidBodyParams &params, double control) {
    const double u = control < 0.0 ? 0.0 : (control > 1.0 ? 1.0 : control);
    return u * params.max_speed_radps;
}

void wrench_in(const RigidBodyParams &params, const double R[9], const double *v_W, const double *w,
               const double *rotor_speed, const double *rotor_accel, Wrench &out) {
    const double dv[3] = {v_W[0] - params.wind_W_mps[0], v_W[1] - params.wind_W_mps[1],
                          v_W[2] - params.wind_W_mps[2]};
    const double air[3] = {R[0] * dv[0] + R[3] * dv[1] + R[6] * dv[2], R[1] * dv[0] + R[4] * dv[1] + R[7] * dv[2],
                           R[2] * dv[0] + R[5] * dv[1] + R[8] * dv[2]};
    double force[3], torque[3] = {0.0, 0.0, 0.0};
    for (int j = 0; j < 3; ++j) {
        force[j] = -(params.body_drag_linear_n_per_mps[j] +
                     params.body_drag_quadratic_n_per_m2ps2[j] * std::fabs(air[j])) *
                   air[j];
    }
    double spin_momentum = 0.0, spin_momentum_rate = 0.0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double *r = params.rotor_position_m[i];
        const double speed = rotor_speed[i];
        const double thrust = params.thrust_coefficient_n_per_radps2 * speed * speed;
        const double drag = params.rotor_drag_kg_per_rad * speed;
        const double hub_x = air[0] + (w[1] * r[2] - w[2] * r[1]);
        const double hub_y = air[1] + (w[2] * r[0] - w[0] * r[2]);
        const double fx = -drag * hub_x, fy = -drag * hub_y;
        force[0] += fx;
        force[1] += fy;
        force[2] += thrust;
        torque[0] += r[1] * thrust - r[2] * fy;
        torque[1] += r[2] * fx - r[0] * thrust;
        torque[2] += (r[0] * fy - r[1] * fx) - params.rotor_spin[i] * params.moment_ratio_m * thrust;
        spin_momentum += params.rotor_spin[i] * params.rotor_inertia_kgm2 * speed;
        spin_momentum_rate += params.rotor_spin[i] * params.rotor_inertia_kgm2 * rotor_accel[i];
    }
    torque[0] -= w[1] * spin_momentum;
    torque[1] += w[0] * spin_momentum;
    torque[2] -= spin_momentum_rate;
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] = force[j];
        out.torque_B[j] = torque[j];
    }
}

// d/dt of (p, q, v, w).
void derivative(const RigidBodyParams &params, const double *s, const double *rotor_speed, const double *rotor_accel,
                double *ds) {
    double R[9];
    rotation(s + kQ, R);
    const double *q = s + kQ, *v = s + kV, *w = s + kW;
    Wrench wrench;
    wrench_in(params, R, v, w, rotor_speed, rotor_accel, wrench);
    const double *f = wrench.force_B;
    const double inv_mass = 1.0 / params.mass_kg;
    for (int j = 0; j < 3; ++j) {
        ds[kP + j] = v[j];
        ds[kV + j] = inv_mass * (R[3 * j] * f[0] + R[3 * j + 1] * f[1] + R[3 * j + 2] * f[2]);
    }
    ds[kV + 2] -= params.gravity_mps2;
    ds[kQ + 0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]);
    ds[kQ + 1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
    ds[kQ + 2] = 0.5 * (q[0] * w[1] - q[1] * w[2] + q[3] * w[0]);
    ds[kQ + 3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
    const double *I = params.inertia_kgm2;
    ds[kW + 0] = (wrench.torque_B[0] - (I[2] - I[1]) * w[1] * w[2]) / I[0];
    ds[kW + 1] = (wrench.torque_B[1] - (I[0] - I[2]) * w[2] * w[0]) / I[1];
    ds[kW + 2] = (wrench.torque_B[2] - (I[1] - I[0]) * w[0] * w[1]) / I[2];
}

}  // namespace

RotorDecay rotor_decay(const RigidBodyParams &params, double dt_s) {
    return {det::exp(-dt_s / params.time_constant_up_s), det::exp(-dt_s / params.time_constant_down_s)};
}

Wrench rotor_and_air_wrench(const RigidBodyParams &params, const double *pose_velocity, const double *rotor_speed,
                            const double *rotor_accel) {
    double R[9];
    rotation(pose_velocity + kQ, R);
    Wrench out;
    wrench_in(params, R, pose_velocity + kV, pose_velocity + kW, rotor_speed, rotor_accel, out);
    return out;
}

double free_flight_tick(const RigidBodyParams &params, RotorDecay half_substep, double substep_s, int substeps,
                        const double *control, double *state, double *path) {
    const int n = params.rotor_count;
    double *rotor = state + kPoseVelocity;
    // A constant command makes each rotor's speed monotone over the tick: up or down is decided once.
    double command[kMaxRotors], decay[kMaxRotors], rate[kMaxRotors], lag[kMaxRotors];
    for (int i = 0; i < n; ++i) {
        command[i] = rotor_command(params, control[i]);
        lag[i] = rotor[i] - command[i];
        const bool up = lag[i] < 0.0;
        decay[i] = up ? half_substep.up : half_substep.down;
        rate[i] = -1.0 / (up ? params.time_constant_up_s : params.time_constant_down_s);
    }
    double speed[3][kMaxRotors], accel[3][kMaxRotors];
    double travelled = 0.0;
    const double h = substep_s, half = 0.5 * substep_s;
    double s[kPoseVelocity];
    for (int k = 0; k < kPoseVelocity; ++k) s[k] = state[k];
    for (int step = 0; step < substeps; ++step) {
        for (int i = 0; i < n; ++i) {
            for (int stage = 0; stage < 3; ++stage) {
                speed[stage][i] = command[i] + lag[i];
                accel[stage][i] = rate[i] * lag[i];
                if (stage < 2) lag[i] *= decay[i];
            }
        }
        double k1[kPoseVelocity], k2[kPoseVelocity], k3[kPoseVelocity], k4[kPoseVelocity], mid[kPoseVelocity];
        derivative(params, s, speed[0], accel[0], k1);
        for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + half * k1[k];
        derivative(params, mid, speed[1], accel[1], k2);
        for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + half * k2[k];
        derivative(params, mid, speed[1], accel[1], k3);
        for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + h * k3[k];
        derivative(params, mid, speed[2], accel[2], k4);
        const double sixth = h / 6.0;
        double moved[3];
        for (int k = 0; k < kPoseVelocity; ++k) {
            const double next = s[k] + sixth * ((k1[k] + k4[k]) + 2.0 * (k2[k] + k3[k]));
            if (k < 3) moved[k] = next - s[k];
            s[k] = next;
        }
        normalise_quaternion(s + kQ);
        travelled += std::sqrt(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]);
        for (int k = 0; k < 7; ++k) path[7 * step + k] = s[k];
    }
    for (int k = 0; k < kPoseVelocity; ++k) state[k] = s[k];
    for (int i = 0; i < n; ++i) rotor[i] = command[i] + lag[i];
    return travelled;
}

Wrench contact_wrench(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *control,
                      const double *state) {
    double accel[kMaxRotors];
    for (int i = 0; i < params.rotor_count; ++i) {
        const double lag = state[kPoseVelocity + i] - rotor_command(params, control[i]);
        accel[i] = lag * ((lag < 0.0 ? substep.up : substep.down) - 1.0) / substep_s;
    }
    return rotor_and_air_wrench(params, state, state + kPoseVelocity, accel);
}

void contact_update(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *control,
                    const double *accel, double *state) {
    const double h = substep_s;
    for (int j = 0; j < 3; ++j) {
        state[kV + j] += h * accel[j];
        state[kW + j] += h * accel[3 + j];
        state[kP + j] += h * state[kV + j];
    }
    const double *w = state + kW;
    const double speed = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    if (speed > 0.0) {
        const double half_angle = 0.5 * h * speed;
        const double s = det::sin(half_angle) / speed;
        const double turn[4] = {det::cos(half_angle), s * w[0], s * w[1], s * w[2]};
        double q[4];
        multiply_quaternion(state + kQ, turn, q);
        normalise_quaternion(q);
        for (int k = 0; k < 4; ++k) state[kQ + k] = q[k];
    }
    for (int i = 0; i < params.rotor_count; ++i) {
        const double command = rotor_command(params, control[i]);
        const double lag = state[kPoseVelocity + i] - command;
        state[kPoseVelocity + i] = command + lag * (lag < 0.0 ? substep.up : substep.down);
    }
}

void rotate_into_body(const double *q_WB, const double *v_W, double *v_B) {
    double R[9];
    rotation(q_WB, R);
    for (int j = 0; j < 3; ++j) v_B[j] = R[j] * v_W[0] + R[3 + j] * v_W[1] + R[6 + j] * v_W[2];
}

void rotate_into_world(const double *q_WB, const double *v_B, double *v_W) {
    double R[9];
    rotation(q_WB, R);
    for (int j = 0; j < 3; ++j) v_W[j] = R[3 * j] * v_B[0] + R[3 * j + 1] * v_B[1] + R[3 * j + 2] * v_B[2];
}

void ideal_imu(const double *q_WB, const double *a_WB_W, const double *w_WB_B, const double *alpha_WB_B, double dt_s,
               double gravity_mps2, double *out) {
    double turn[4] = {1.0, 0.0, 0.0, 0.0}, q_mid[4];
    for (int j = 0; j < 3; ++j) {
        out[3 + j] = w_WB_B[j] - 0.5 * dt_s * alpha_WB_B[j];
        // Mean rate over the second half of the step, times that half, is the turn from mid-step to its end;
        // half of it is the vector part of the quaternion, to third order in the angle.
        turn[1 + j] = -0.25 * dt_s * (w_WB_B[j] - 0.25 * dt_s * alpha_WB_B[j]);
    }
    multiply_quaternion(q_WB, turn, q_mid);
    const double f_W[3] = {a_WB_W[0], a_WB_W[1], a_WB_W[2] + gravity_mps2};
    rotate_into_body(q_mid, f_W, out);
}

}  // namespace hil::sim
