// Multirotor rigid body: the equations of motion and the pieces of a contact step. Free flight: free_flight.hpp.
//
// Frames: W world ENU, B body FLU with its origin at the centre of mass and its axes the principal axes.
// Units SI. Quaternions w-x-y-z, rotating B into W.
//
// State, float64, contiguous, 13 + n values:   p_WB[3]  q_WB[4]  v_WB_W[3]  w_WB_B[3]  rotor_speed[n] (>= 0)
//
// Equations (R = R(q_WB), n_i the axis of rotor i in B, the direction of its thrust, spin s_i = +1 for a rotor turning
// counter-clockwise seen from above, a = R^T (v - wind) the body's velocity through the air in B, u_i = a + w x r_i
// that of hub i, u_ni = u_i . n_i along the axis):
//   command      c_i = O_max (V / V_nominal) sqrt(f u^2 + (1 - f) u),  u clamped to 0..1
//                f = 1: speed proportional to the command, thrust quadratic in it;  f = 0: thrust proportional.
//                (f is PX4's THR_MDL_FAC.) V / V_nominal is 1 without a battery: battery.hpp
//   rotor        dO_i/dt = (c_i - O_i) / tau,  tau = tau_up if c_i > O_i else tau_down
//   thrust       T_i = (k_i O_i (O_i - c_i O_j) G_i V_i - k_z O_i u_ni) n_i                 (rotor_air.hpp)
//   rotor drag   H_i = -k_d O_i (u_i - u_ni n_i)
//   imbalance    U_i = b_i O_i^2 (cos phi_i e1_i + sin phi_i e2_i),  dphi_i/dt = s_i O_i    (a rotor with a lost blade)
//                e1_i = x_B - (x_B . n_i) n_i, normalised;  e2_i = n_i x e1_i
//   body drag    D_j = -(d1_j + d2_j |a|) a_j
//   m dv/dt  = R (sum T_i + sum H_i + sum U_i + D) - m g z_W
//   I dw/dt  = sum r_i x (T_i + H_i + U_i) - sum s_i m_i O_i^2 n_i - w x (I w + h) - dh/dt,  h = sum s_i J O_i n_i
//   dq/dt    = q (0, w) / 2
// Coaxial pair: the lower rotor i works in the wake of the upper rotor j, whose velocity is proportional to O_j. By blade
// element theory the thrust that it loses is proportional to its own speed and to that velocity, as with k_z. At equal
// speeds its thrust is the share 1 - c_i of that alone; c_i = 0 for any other rotor.
// A vehicle whose rotors all have n_i = (0, 0, 1) and c_i = 0 takes a shorter branch, `upright`.
// A rotor's reaction on the body is opposite to its spin: counter-clockwise rotors turn the body clockwise. Its torque
// m_i O_i^2 depends on its speed alone: the ground effect changes the thrust at a speed, not the power.
//
// Drag uses the magnitude of the whole velocity, not each axis alone, which keeps the force smooth where a component
// changes sign.
//
// Determinism: + - * / sqrt and detmath.hpp only, fixed order. No allocation, no global state, not thread-safe on
// the same state. Arguments must not alias unless stated otherwise.
#pragma once

#include "battery.hpp"
#include "rotor_air.hpp"

namespace hil::sim {

inline constexpr int kMaxRotors = 8;
inline constexpr int kPoseVelocity = 13;  // p, q, v, w
inline constexpr int kP = 0, kQ = 3, kV = 7, kW = 10;

struct RigidBodyParams {
    double mass_kg;
    double inertia_kgm2[3];
    int rotor_count;  // 1..kMaxRotors
    double rotor_position_m[kMaxRotors][3];
    double rotor_spin[kMaxRotors];  // +1 counter-clockwise seen from above, -1 clockwise
    double thrust_coefficient_n_per_radps2;
    double moment_ratio_m;
    double max_speed_radps;
    double thrust_model_factor;  // f
    double time_constant_up_s;
    double time_constant_down_s;
    double rotor_inertia_kgm2;
    double rotor_drag_kg_per_rad;
    double body_drag_linear_n_per_mps[3];
    double body_drag_quadratic_n_per_m2ps2[3];
    double gravity_mps2;
    RotorAir air;
    BatteryParams battery;
    // State of each rotor; faults may change it between ticks.
    double thrust_left[kMaxRotors];       // k_i = thrust_left k, m_i = thrust_left m_ratio k
    double forced_speed_radps[kMaxRotors];  // < 0: follows its command
    double imbalance_kgm[kMaxRotors];     // b_i
    bool imbalanced;                      // any b_i > 0
    bool upright;                         // all n_i = (0, 0, 1) and all c_i = 0
    double rotor_axis[kMaxRotors][3];     // n_i
    double rotor_plane[kMaxRotors][2][3]; // e1_i, e2_i
    double coaxial_loss[kMaxRotors];      // c_i
    int rotor_above[kMaxRotors];          // j; its own index i without a rotor above
};

// Sets axis and rotor above of all rotors, and what follows from them. `axis`: unit vectors. `above`: -1 for none.
void set_rotor_axes(RigidBodyParams &params, const double (*axis)[3], const int *above, double coaxial_loss);

// Rotors at one instant.
struct RotorStage {
    double speed[kMaxRotors];
    double accel[kMaxRotors];
    double push_x[kMaxRotors], push_y[kMaxRotors];  // U_i along e1_i and e2_i; read only if imbalanced
};

// e^{-dt/tau} for spin-up and spin-down.
struct RotorDecay {
    double up;
    double down;
};
RotorDecay rotor_decay(const RigidBodyParams &params, double dt_s);

// Steady speed of rotor `i` at command `control`, `scale` = V / V_nominal.
double commanded_speed(const RigidBodyParams &params, int i, double control, double scale);

// Velocity of the vehicle through the air, in B.
inline void air_velocity(const double R[9], const double *s, const double *wind_W, double air[3]) {
    const double dv[3] = {s[kV] - wind_W[0], s[kV + 1] - wind_W[1], s[kV + 2] - wind_W[2]};
    air[0] = R[0] * dv[0] + R[3] * dv[1] + R[6] * dv[2];
    air[1] = R[1] * dv[0] + R[4] * dv[1] + R[7] * dv[2];
    air[2] = R[2] * dv[0] + R[5] * dv[1] + R[8] * dv[2];
}

// Velocity through the air of a rotor's hub at `r`, in B: air + w x r.
inline void hub_velocity(const double air[3], const double *w, const double *r, double hub[3]) {
    hub[0] = air[0] + (w[1] * r[2] - w[2] * r[1]);
    hub[1] = air[1] + (w[2] * r[0] - w[0] * r[2]);
    hub[2] = air[2] + (w[0] * r[1] - w[1] * r[0]);
}

struct Wrench {
    double force_B[3];
    double torque_B[3];  // about the centre of mass; holds the rotors' gyroscopic terms, not w x (I w)
};

// Wrench on the body without gravity and contact. `s`: p, q, v, w.
void rotor_and_air_wrench(const RigidBodyParams &params, const double *s, const RotorStage &rotors,
                          const double *wind_W, Wrench &out);

// d/dt of (p, q, v, w).
void derivative(const RigidBodyParams &params, const double *s, const RotorStage &rotors, const double *wind_W,
                double *ds);

// Shaft power of all rotors [W].
double shaft_power_w(const RigidBodyParams &params, const double *rotor_speed);

// Wrench at `state` for a contact sub-step with the mean rotor acceleration over it. `command`: steady speeds.
Wrench contact_wrench(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *command,
                      const double *wind_W, const double *state);

// Contact sub-step with the accelerations of MuJoCo: dv/dt in W, dw/dt in B (qacc of a free joint).
//   v += h dv/dt, then p += h v                                   semi-implicit Euler, loses energy in free fall
//   w += h (dw/dt + I^-1 w x I w), then (q, w) turn freely for h    the gyroscopic part by RK4: an explicit step
//                                                                 would add energy to a tumbling vehicle
// Rotor speeds advance in closed form.
void contact_update(const RigidBodyParams &params, RotorDecay substep, double substep_s, const double *command,
                    const double *accel, double *state);

void normalise_quaternion(double *q);

// Mean specific force [m/s2] and mean angular rate [rad/s] in B over the step of dt_s that just ended.
//   rate   w(end) - alpha dt/2                      exact mean when w changes linearly
//   force  R(q_mid)^T (a + g z_W),  q_mid = attitude at mid-step
// f is a mean over the step, so the attitude at its end would add an error of |w| dt/2 (0.01 rad at 5 rad/s and 250 Hz,
// or 0.1 m/s2 of gravity sideways). At mid-step the error is O(dt^2).
// `out` = force[3], rate[3].
void ideal_imu(const double *q_WB, const double *a_WB_W, const double *w_WB_B, const double *alpha_WB_B, double dt_s,
               double gravity_mps2, double *out);

}  // namespace hil::sim
