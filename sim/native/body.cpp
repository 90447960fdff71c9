#include "body.hpp"

#include <cmath>

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
void rate_of_spin(const Inertia &inertia, const double *w, const double *torque, double *dw) {
    const double *I = inertia.moments_kgm2;
    if (inertia.skewed) {
        const double *T = inertia.tensor_kgm2, *inverse = inertia.inverse;
        double L[3], rest[3];
        for (int j = 0; j < 3; ++j) L[j] = (T[3 * j] * w[0] + T[3 * j + 1] * w[1]) + T[3 * j + 2] * w[2];
        rest[0] = torque[0] - (w[1] * L[2] - w[2] * L[1]);
        rest[1] = torque[1] - (w[2] * L[0] - w[0] * L[2]);
        rest[2] = torque[2] - (w[0] * L[1] - w[1] * L[0]);
        for (int j = 0; j < 3; ++j) {
            dw[j] = (inverse[3 * j] * rest[0] + inverse[3 * j + 1] * rest[1]) + inverse[3 * j + 2] * rest[2];
        }
        return;
    }
    dw[0] = (torque[0] - (I[2] - I[1]) * w[1] * w[2]) / I[0];
    dw[1] = (torque[1] - (I[0] - I[2]) * w[2] * w[0]) / I[1];
    dw[2] = (torque[2] - (I[1] - I[0]) * w[0] * w[1]) / I[2];
}

// Advances (q, w) without torque by h, in one RK4 step.
void turn_freely(const Inertia &I, double h, double *q, double *w) {
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

Inertia inertia_of(double mass_kg, const double *m, const double *p) {
    Inertia out{mass_kg, {m[0], m[1], m[2]}};
    out.skewed = p[0] != 0.0 || p[1] != 0.0 || p[2] != 0.0;
    if (!out.skewed) return out;
    const double T[9] = {m[0], -p[0], -p[1], -p[0], m[1], -p[2], -p[1], -p[2], m[2]};
    double *inverse = out.inverse;
    for (int i = 0; i < 3; ++i) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        for (int j = 0; j < 3; ++j) {
            const int c = (j + 1) % 3, d = (j + 2) % 3;
            inverse[3 * j + i] = T[3 * a + c] * T[3 * b + d] - T[3 * a + d] * T[3 * b + c];
        }
    }
    const double determinant = (T[0] * inverse[0] + T[1] * inverse[3]) + T[2] * inverse[6];
    double trace = 0.0;
    for (int k = 0; k < 9; ++k) {
        out.tensor_kgm2[k] = T[k];
        inverse[k] /= determinant;
    }
    for (int j = 0; j < 3; ++j) trace += inverse[4 * j];
    out.least_principal_kgm2 = 1.0 / trace;  // a lower bound: the trace of the inverse is the sum of 1 / I_j
    return out;
}

void instant_at(const Body &body, const double *s, const double *wind_W, Instant &now) {
    now.s = s;
    rotation_matrix(s + kQ, now.R);
    air_velocity(now.R, s, wind_W, now.air_B);
    now.density_ratio = body.air.ratio(s[kP + 2]);
}

void wrench_at(const Body &body, const double *s, const double *wind_W, Instant &now, Wrench &out) {
    instant_at(body, s, wind_W, now);
    // Minus zero is the one number to which anything is added without a change.
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] = -0.0;
        out.torque_B[j] = 0.0;
    }
    for (const Force *force : body.forces) force->add(now, out);
}

void derivative(const Body &body, const double *s, const double *wind_W, double *ds) {
    Instant now;
    Wrench wrench;
    wrench_at(body, s, wind_W, now, wrench);
    const double *f = wrench.force_B, *R = now.R;
    const double inv_mass = 1.0 / body.inertia.mass_kg;
    for (int j = 0; j < 3; ++j) {
        ds[kP + j] = s[kV + j];
        ds[kV + j] = inv_mass * (R[3 * j] * f[0] + R[3 * j + 1] * f[1] + R[3 * j + 2] * f[2]);
    }
    ds[kV + 2] -= body.gravity_mps2;
    quaternion_rate(s + kQ, s + kW, ds + kQ);
    rate_of_spin(body.inertia, s + kW, wrench.torque_B, ds + kW);
}

Wrench contact_wrench(const Body &body, bool hard, const double *wind_W, const double *state) {
    for (std::size_t k = 0; k < body.forces.size(); ++k) body.forces[k]->at_contact(state + body.first_state[k], hard);
    Instant now;
    Wrench out;
    wrench_at(body, state, wind_W, now, out);
    return out;
}

void contact_update(const Body &body, bool hard, double substep_s, const double *accel, double *state) {
    static constexpr double kFree[3] = {0.0, 0.0, 0.0};
    const double h = substep_s;
    const Inertia &I = body.inertia;
    double gyroscopic[3];
    rate_of_spin(I, state + kW, kFree, gyroscopic);
    for (int j = 0; j < 3; ++j) {
        state[kV + j] += h * accel[j];
        state[kP + j] += h * state[kV + j];
        state[kW + j] += h * (accel[3 + j] - gyroscopic[j]);
    }
    turn_freely(I, h, state + kQ, state + kW);
    for (std::size_t k = 0; k < body.forces.size(); ++k) body.forces[k]->end_contact(state + body.first_state[k], hard);
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
