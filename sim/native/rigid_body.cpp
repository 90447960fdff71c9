#include "rigid_body.hpp"

#include <cmath>

#include "detmath.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

void quaternion_rate(const double *q, const double *w, double *dq) {
    dq[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]);
    dq[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
    dq[2] = 0.5 * (q[0] * w[1] - q[1] * w[2] + q[3] * w[0]);
    dq[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
}

// dw/dt by Euler's equations.
void rate_of_spin(const double *I, const double *w, const double *torque, double *dw) {
    dw[0] = (torque[0] - (I[2] - I[1]) * w[1] * w[2]) / I[0];
    dw[1] = (torque[1] - (I[0] - I[2]) * w[2] * w[0]) / I[1];
    dw[2] = (torque[2] - (I[1] - I[0]) * w[0] * w[1]) / I[2];
}

// Drag of the airframe in B.
inline void body_drag(const RigidBodyParams &params, const double air[3], double force[3]) {
    const double airspeed = std::sqrt((air[0] * air[0] + air[1] * air[1]) + air[2] * air[2]);
    for (int j = 0; j < 3; ++j) {
        force[j] =
            -(params.body_drag_linear_n_per_mps[j] + params.body_drag_quadratic_n_per_m2ps2[j] * airspeed) * air[j];
    }
}

void wrench_in(const RigidBodyParams &params, const double R[9], const double *s, const RotorStage &rotors,
               const double *wind_W, Wrench &out) {
    const double *w = s + kW;
    double air[3];
    air_velocity(R, s, wind_W, air);
    double force[3], torque[3] = {0.0, 0.0, 0.0};
    body_drag(params, air, force);
    const RotorAir &effects = params.air;
    const bool near_ground = effects.ground_floor > 0.0, descends = effects.descent_loss > 0.0;
    double spin_momentum = 0.0, spin_momentum_rate = 0.0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double *r = params.rotor_position_m[i];
        const double speed = rotors.speed[i];
        const double speed2 = speed * speed;
        const double static_thrust = params.thrust_coefficient_n_per_radps2 * params.thrust_left[i] * speed2;
        const double drag = params.rotor_drag_kg_per_rad * speed;
        double hub[3];
        hub_velocity(air, w, r, hub);
        double thrust = static_thrust;
        if (near_ground || descends) {
            const double induced2 = effects.kappa_m2 * speed2;
            const double across2 = hub[0] * hub[0] + hub[1] * hub[1];
            if (near_ground) {
                const double height = s[kP + 2] + ((R[6] * r[0] + R[7] * r[1]) + R[8] * r[2]);
                thrust *= ground_ratio(effects, height, R[8], induced2, across2);
            }
            if (descends) thrust *= descent_ratio(effects, hub[2], induced2, across2);
        }
        thrust -= effects.axial_kg_per_rad * speed * hub[2];
        double fx = -drag * hub[0], fy = -drag * hub[1];
        if (params.imbalanced) {
            fx += rotors.push_x[i];
            fy += rotors.push_y[i];
        }
        force[0] += fx;
        force[1] += fy;
        force[2] += thrust;
        torque[0] += r[1] * thrust - r[2] * fy;
        torque[1] += r[2] * fx - r[0] * thrust;
        torque[2] += (r[0] * fy - r[1] * fx) - params.rotor_spin[i] * params.moment_ratio_m * static_thrust;
        spin_momentum += params.rotor_spin[i] * params.rotor_inertia_kgm2 * speed;
        spin_momentum_rate += params.rotor_spin[i] * params.rotor_inertia_kgm2 * rotors.accel[i];
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
void tilted_wrench_in(const RigidBodyParams &params, const double R[9], const double *s, const RotorStage &rotors,
                      const double *wind_W, Wrench &out) {
    const double *w = s + kW;
    double air[3];
    air_velocity(R, s, wind_W, air);
    double force[3], torque[3] = {0.0, 0.0, 0.0}, spin_momentum[3] = {0.0, 0.0, 0.0};
    body_drag(params, air, force);
    const RotorAir &effects = params.air;
    const bool near_ground = effects.ground_floor > 0.0, descends = effects.descent_loss > 0.0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double *r = params.rotor_position_m[i], *n = params.rotor_axis[i];
        const double speed = rotors.speed[i];
        const double k = params.thrust_coefficient_n_per_radps2 * params.thrust_left[i];
        double hub[3], across[3];
        hub_velocity(air, w, r, hub);
        const double axial = (hub[0] * n[0] + hub[1] * n[1]) + hub[2] * n[2];
        for (int j = 0; j < 3; ++j) across[j] = hub[j] - axial * n[j];
        double thrust = k * speed * (speed - params.coaxial_loss[i] * rotors.speed[params.rotor_above[i]]);
        if (near_ground || descends) {
            const double induced2 = effects.kappa_m2 * (speed * speed);
            const double across2 = (across[0] * across[0] + across[1] * across[1]) + across[2] * across[2];
            if (near_ground) {
                const double height = s[kP + 2] + ((R[6] * r[0] + R[7] * r[1]) + R[8] * r[2]);
                const double up = (R[6] * n[0] + R[7] * n[1]) + R[8] * n[2];
                thrust *= ground_ratio(effects, height, up, induced2, across2);
            }
            if (descends) thrust *= descent_ratio(effects, axial, induced2, across2);
        }
        thrust -= effects.axial_kg_per_rad * speed * axial;
        const double drag = params.rotor_drag_kg_per_rad * speed;
        const double reaction = params.rotor_spin[i] * params.moment_ratio_m * (k * (speed * speed));
        const double momentum = params.rotor_spin[i] * params.rotor_inertia_kgm2 * speed;
        const double momentum_rate = params.rotor_spin[i] * params.rotor_inertia_kgm2 * rotors.accel[i];
        double f[3];
        for (int j = 0; j < 3; ++j) {
            f[j] = thrust * n[j] - drag * across[j];
            if (params.imbalanced) {
                f[j] += rotors.push_x[i] * params.rotor_plane[i][0][j] + rotors.push_y[i] * params.rotor_plane[i][1][j];
            }
            force[j] += f[j];
            torque[j] -= (reaction + momentum_rate) * n[j];
            spin_momentum[j] += momentum * n[j];
        }
        torque[0] += r[1] * f[2] - r[2] * f[1];
        torque[1] += r[2] * f[0] - r[0] * f[2];
        torque[2] += r[0] * f[1] - r[1] * f[0];
    }
    const double *h = spin_momentum;
    torque[0] -= w[1] * h[2] - w[2] * h[1];
    torque[1] -= w[2] * h[0] - w[0] * h[2];
    torque[2] -= w[0] * h[1] - w[1] * h[0];
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] = force[j];
        out.torque_B[j] = torque[j];
    }
}

// Advances (q, w) without torque by h, in one RK4 step.
void turn_freely(const double *I, double h, double *q, double *w) {
    static constexpr double kFree[3] = {0.0, 0.0, 0.0};
    double y[7], k[4][7], mid[7];
    for (int j = 0; j < 4; ++j) y[j] = q[j];
    for (int j = 0; j < 3; ++j) y[4 + j] = w[j];
    for (int stage = 0; stage < 4; ++stage) {
        const double reach = stage == 0 ? 0.0 : (stage == 3 ? h : 0.5 * h);
        for (int j = 0; j < 7; ++j) mid[j] = stage == 0 ? y[j] : y[j] + reach * k[stage - 1][j];
        quaternion_rate(mid, mid + 4, k[stage]);
        rate_of_spin(I, mid + 4, kFree, k[stage] + 4);
    }
    for (int j = 0; j < 7; ++j) y[j] += h / 6.0 * ((k[0][j] + k[3][j]) + 2.0 * (k[1][j] + k[2][j]));
    normalise_quaternion(y);
    for (int j = 0; j < 4; ++j) q[j] = y[j];
    for (int j = 0; j < 3; ++j) w[j] = y[4 + j];
}

}  // namespace

void normalise_quaternion(double *q) {
    const double s = 1.0 / std::sqrt((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]));
    for (int i = 0; i < 4; ++i) q[i] *= s;
}

void set_rotor_axes(RigidBodyParams &params, const double (*axis)[3], const int *above, double coaxial_loss) {
    params.upright = true;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double *n = axis[i];
        double *e1 = params.rotor_plane[i][0], *e2 = params.rotor_plane[i][1];
        const double across = std::sqrt(n[1] * n[1] + n[2] * n[2]);
        for (int j = 0; j < 3; ++j) {
            params.rotor_axis[i][j] = n[j];
            e1[j] = ((j == 0 ? 1.0 : 0.0) - n[0] * n[j]) / across;
        }
        e2[0] = n[1] * e1[2] - n[2] * e1[1];
        e2[1] = n[2] * e1[0] - n[0] * e1[2];
        e2[2] = n[0] * e1[1] - n[1] * e1[0];
        params.rotor_above[i] = above[i] < 0 ? i : above[i];
        params.coaxial_loss[i] = above[i] < 0 ? 0.0 : coaxial_loss;
        if (n[0] != 0.0 || n[1] != 0.0 || n[2] != 1.0 || params.coaxial_loss[i] != 0.0) params.upright = false;
    }
}

RotorDecay rotor_decay(const RigidBodyParams &params, double dt_s) {
    return {det::exp(-dt_s / params.time_constant_up_s), det::exp(-dt_s / params.time_constant_down_s)};
}

double commanded_speed(const RigidBodyParams &params, int i, double control, double scale) {
    if (params.forced_speed_radps[i] >= 0.0) return params.forced_speed_radps[i];
    const double u = control < 0.0 ? 0.0 : (control > 1.0 ? 1.0 : control);
    const double f = params.thrust_model_factor;
    const double relative = f == 1.0 ? u : std::sqrt(f * (u * u) + (1.0 - f) * u);
    return relative * params.max_speed_radps * scale;
}

void rotor_and_air_wrench(const RigidBodyParams &params, const double *s, const RotorStage &rotors,
                          const double *wind_W, Wrench &out) {
    double R[9];
    rotation_matrix(s + kQ, R);
    if (params.upright) {
        wrench_in(params, R, s, rotors, wind_W, out);
    } else {
        tilted_wrench_in(params, R, s, rotors, wind_W, out);
    }
}

void derivative(const RigidBodyParams &params, const double *s, const RotorStage &rotors, const double *wind_W,
                double *ds) {
    double R[9];
    rotation_matrix(s + kQ, R);
    Wrench wrench;
    if (params.upright) {
        wrench_in(params, R, s, rotors, wind_W, wrench);
    } else {
        tilted_wrench_in(params, R, s, rotors, wind_W, wrench);
    }
    const double *f = wrench.force_B;
    const double inv_mass = 1.0 / params.mass_kg;
    for (int j = 0; j < 3; ++j) {
        ds[kP + j] = s[kV + j];
        ds[kV + j] = inv_mass * (R[3 * j] * f[0] + R[3 * j + 1] * f[1] + R[3 * j + 2] * f[2]);
    }
    ds[kV + 2] -= params.gravity_mps2;
    quaternion_rate(s + kQ, s + kW, ds + kQ);
    rate_of_spin(params.inertia_kgm2, s + kW, wrench.torque_B, ds + kW);
}

double shaft_power_w(const RigidBodyParams &params, const double *rotor_speed) {
    double power = 0.0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double speed = rotor_speed[i];
        power += params.thrust_left[i] * (speed * speed * speed);
    }
    return params.moment_ratio_m * params.thrust_coefficient_n_per_radps2 * power;
}

Wrench contact_wrench(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *command,
                      const double *wind_W, const double *state) {
    RotorStage rotors;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double lag = state[kPoseVelocity + i] - command[i];
        rotors.speed[i] = state[kPoseVelocity + i];
        rotors.accel[i] = lag * ((lag < 0.0 ? substep.up : substep.down) - 1.0) / substep_s;
        // The force of an unbalanced rotor averages out over a contact sub-step, and the feet hold the vehicle.
        rotors.push_x[i] = rotors.push_y[i] = 0.0;
    }
    Wrench out;
    rotor_and_air_wrench(params, state, rotors, wind_W, out);
    return out;
}

void contact_update(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *command,
                    const double *accel, double *state) {
    static constexpr double kFree[3] = {0.0, 0.0, 0.0};
    const double h = substep_s;
    double gyroscopic[3];
    rate_of_spin(params.inertia_kgm2, state + kW, kFree, gyroscopic);
    for (int j = 0; j < 3; ++j) {
        state[kV + j] += h * accel[j];
        state[kP + j] += h * state[kV + j];
        state[kW + j] += h * (accel[3 + j] - gyroscopic[j]);
    }
    turn_freely(params.inertia_kgm2, h, state + kQ, state + kW);
    for (int i = 0; i < params.rotor_count; ++i) {
        const double lag = state[kPoseVelocity + i] - command[i];
        state[kPoseVelocity + i] = command[i] + lag * (lag < 0.0 ? substep.up : substep.down);
    }
}

void ideal_imu(const double *q_WB, const double *a_WB_W, const double *w_WB_B, const double *alpha_WB_B, double dt_s,
               double gravity_mps2, double *out) {
    double turn[3];
    for (int j = 0; j < 3; ++j) {
        out[3 + j] = w_WB_B[j] - 0.5 * dt_s * alpha_WB_B[j];
        // The mean rate over the second half of the step, times its duration, is the rotation from mid-step to the end.
        // Half of it is the vector part of the quaternion, to third order in the angle.
        turn[j] = -0.25 * dt_s * (w_WB_B[j] - 0.25 * dt_s * alpha_WB_B[j]);
    }
    const Quat mid = Quat{q_WB[0], q_WB[1], q_WB[2], q_WB[3]} * Quat{1.0, turn[0], turn[1], turn[2]};
    const double q_mid[4] = {mid.w, mid.x, mid.y, mid.z};
    const double f_W[3] = {a_WB_W[0], a_WB_W[1], a_WB_W[2] + gravity_mps2};
    rotate_into_body(q_mid, f_W, out);
}

}  // namespace hil::sim
