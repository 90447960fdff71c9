// Rigid body with a list of forces: the equations of motion and the pieces of a contact step. Free flight:
// free_flight.hpp. Forces: forces/force.hpp, one file each.
//
// Frames: W world ENU, B body FLU with its origin at the centre of mass. Its axes are the principal axes unless the inertia
// is `skewed`, I then the full tensor.
// Units SI. Quaternions w-x-y-z, rotating B into W.
//
// State, float64, contiguous, 13 + n values:   p_WB[3]  q_WB[4]  v_WB_W[3]  w_WB_B[3]  own states of the forces[n]
//
// Equations (R = R(q_WB), F_k and M_k the force and torque of each entry of the list, in B):
//   m dv/dt  = R sum F_k - m g z_W
//   I dw/dt  = sum M_k - w x (I w)
//   dq/dt    = q (0, w) / 2
//
// Determinism: + - * / sqrt and detmath.hpp only, fixed order. No allocation, no global state, not thread-safe on
// the same state. Arguments must not alias unless stated otherwise.
#pragma once

#include <vector>

#include "air_density.hpp"
#include "forces/force.hpp"

namespace hil::sim {

struct Body {
    Inertia inertia;
    double gravity_mps2;
    std::vector<Force *> forces;   // in the order of their own states, which is also that of their commands
    std::vector<int> first_state;  // of each force, in the state
    int states;                    // 13 + n
    int commands;
    int integrals;                 // values of the forces that are integrated with the body
    AirDensity air;
};

// What forces see of the body at `s` (p, q, v, w).
void instant_at(const Body &body, const double *s, const double *wind_W, Instant &now);

// Sum of the forces at `s` (p, q, v, w), with the own states that they hold. `now` is written too.
void wrench_at(const Body &body, const double *s, const double *wind_W, Instant &now, Wrench &out);

// Inertia of moments [Ixx, Iyy, Izz] and products [Ixy, Ixz, Iyz], Ixy = int x y dm: off-diagonal elements of the tensor are
// their negatives.
Inertia inertia_of(double mass_kg, const double *moments_kgm2, const double *products_kgm2);

// d/dt of (p, q, v, w).
void derivative(const Body &body, const double *s, const double *wind_W, double *ds);

// Wrench at `state` for a contact sub-step, with the mean rates of the own states over it.
Wrench contact_wrench(const Body &body, bool hard, const double *wind_W, const double *state);

// Contact sub-step with the accelerations of MuJoCo: dv/dt in W, dw/dt in B (qacc of a free joint).
//   v += h dv/dt, then p += h v                                   semi-implicit Euler, loses energy in free fall
//   w += h (dw/dt + I^-1 w x I w), then (q, w) turn freely for h    the gyroscopic part by RK4: an explicit step
//                                                                 would add energy to a tumbling vehicle
void contact_update(const Body &body, bool hard, double substep_s, const double *accel, double *state);

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
