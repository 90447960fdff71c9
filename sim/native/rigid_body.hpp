// Multirotor rigid body: free flight by RK4 and the pieces of a contact step.
//
// Frames: W world ENU, B body FLU with its origin at the centre of mass and its axes the principal axes.
// Units SI. Quaternions w-x-y-z, rotating B into W.
//
// State, float64, contiguous, 13 + n values:   p_WB[3]  q_WB[4]  v_WB_W[3]  w_WB_B[3]  rotor_speed[n] (>= 0)
//
// Equations (R = R(q_WB), e_z the body's up axis, spin s_i = +1 for a rotor turning counter-clockwise seen from
// above, u_i = R^T (v - wind) + w x r_i the air velocity at hub i in B):
//   rotor        dO_i/dt = (c_i - O_i) / tau,  tau = tau_up if c_i > O_i else tau_down, c_i = clamp(u, 0, 1) O_max
//   thrust       T_i = k O_i^2 e_z
//   rotor drag   H_i = -k_d O_i (u_ix, u_iy, 0)
//   body drag    D_j = -(d1_j + d2_j |a_j|) a_j,  a = R^T (v - wind)
//   m dv/dt  = R (sum T_i + sum H_i + D) - m g z_W
//   I dw/dt  = sum r_i x (T_i + H_i) - sum s_i m_ratio T_i e_z - w x (I w + h e_z) - dh/dt e_z,  h = sum s_i J O_i
//   dq/dt    = q (0, w) / 2
// A rotor's reaction on the body is opposite to its own spin: counter-clockwise rotors turn the body clockwise.
//
// Integration: the rotor equation is linear with a constant command over one tick, so it is solved in closed form
// and evaluated at the RK stages; (p, q, v, w) go by classical RK4 with q renormalised after every sub-step.
// Measured order 4 (tests/reference/test_sim_integration.py).
//
// Determinism: + - * / sqrt and detmath.hpp only, fixed order. No allocation, no global state, not thread-safe on
// the same state. Arguments must not alias unless said otherwise.
#pragma once

namespace hil::sim {

inline constexpr int kMaxRotors = 8;
inline constexpr int kPoseVelocity = 13;  // p, q, v, w

struct RigidBodyParams {
    double mass_kg;
    double inertia_kgm2[3];
    int rotor_count;  // 1..kMaxRotors
    double rotor_position_m[kMaxRotors][3];
    double rotor_spin[kMaxRotors];  // +1 counter-clockwise seen from above, -1 clockwise
    double thrust_coefficient_n_per_radps2;
    double moment_ratio_m;
    double max_speed_radps;
    double time_constant_up_s;
    double time_constant_down_s;
    double rotor_inertia_kgm2;
    double rotor_drag_kg_per_rad;
    double body_drag_linear_n_per_mps[3];
    double body_drag_quadratic_n_per_m2ps2[3];
    double gravity_mps2;
    double wind_W_mps[3];
};

// Decay over half a free-flight sub-step and over a contact sub-step, e^{-dt/tau}, for spin-up and spin-down.
struct RotorDecay {
    double up;
    double down;
};
RotorDecay rotor_decay(const RigidBodyParams &params, double dt_s);

struct Wrench {
    double force_B[3];
    double torque_B[3];  // about the centre of mass; holds the rotors' gyroscopic terms, not w x (I w)
};

// Everything that acts on the body but gravity and contact.
Wrench rotor_and_air_wrench(const RigidBodyParams &params, const double *pose_velocity, const double *rotor_speed,
                            const double *rotor_accel);

// One tick without contact: `substeps` RK4 steps of `substep_s`. `state` in and out. `control` holds rotor_count
// finite values. `path` receives p and q after each sub-step, [substeps][7]. Returns the length of the polygon
// through the sub-step positions [m].
double free_flight_tick(const RigidBodyParams &params, RotorDecay half_substep, double substep_s, int substeps,
                        const double *control, double *state, double *path);

// Wrench at `state` for a contact sub-step with the mean rotor acceleration over it.
Wrench contact_wrench(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *control,
                      const double *state);

// Semi-implicit Euler: v += h a, w += h alpha, then p += h v, q = q exp(h w), rotors in closed form.
// `accel` is dv/dt in W and dw/dt in B (MuJoCo's qacc of a free joint).
void contact_update(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *control,
                    const double *accel, double *state);

// v_B = R(q)^T v_W and v_W = R(q) v_B for a unit quaternion.
void rotate_into_body(const double *q_WB, const double *v_W, double *v_B);
void rotate_into_world(const double *q_WB, const double *v_B, double *v_W);

// Mean specific force [m/s2] and mean angular rate [rad/s] in B over the step of dt_s that just ended.
//   rate   w(end) - alpha dt/2                      exact mean when w changes linearly
//   force  R(q_mid)^T (a + g z_W),  q_mid = attitude at mid-step
// Mid-step and not step-end: f is a mean over the step, and turning it with the end attitude would be wrong by
// |w| dt/2 (0.01 rad at 5 rad/s and 250 Hz, 0.1 m/s2 of gravity leaking sideways); mid-step leaves O(dt^2).
// `out` = force[3], rate[3].
void ideal_imu(const double *q_WB, const double *a_WB_W, const double *w_WB_B, const double *alpha_WB_B, double dt_s,
               double gravity_mps2, double *out);

}  // namespace hil::sim
