// Free flight of the rigid body of rigid_body.hpp over one tick with constant commands.
//
// The rotor equation is linear with a constant command, so it is solved in closed form and evaluated at the stages of
// the integrator: rotors and body are consistent at every stage, and the body's order is not lost to the lag.
// (p, q, v, w) go by one of two explicit Runge-Kutta methods, q renormalised after every step:
//
//   classical, order 4               n0 steps a tick (2 ms or less), the ordinary case
//   Dormand-Prince, order 8, 12 stages (Hairer, Norsett, Wanner, Solving ODEs I, 2nd ed., II.5)   one step a tick, when
//                                    |w| > 8 rad/s or a rotor whirls out of balance
//
// A rotating body asks for order: over an hour at 20 rad/s the classical method at 2 ms would lose 1e-4 of the energy
// ((w h)^6 / 72 a step), the other one less than 1e-9 at twice the step.
//
// Steps are halved, up to 64 times as many, until h is short enough for what the state says at the tick's start:
//   classical        lambda h <= 1
//   Dormand-Prince   lambda h <= 2,  |w| h <= 0.1,  O h <= 1 with a rotor out of balance
//   lambda = 2 d2 |a| / m + d1 / m + k_d sum O_max (1/m + |r|^2 / I_min) + k_z ... + sum J O_max / I_min
// a bound of the fastest damping and of the gyroscopic rate, so that a light vehicle in a gale stays stable.
// The choice is a function of the state alone: same bits everywhere, and with contact skipping on or off.
//
// Wind within the tick: wind(t) = start + t slope.
#pragma once

#include "rigid_body.hpp"

namespace hil::sim {

inline constexpr int kLevels = 7;   // steps of a tick: base * 2^level
inline constexpr int kStages8 = 12;

struct TickPlan {
    double tick_s;
    int substeps;                            // n0
    double static_rate_per_s;                // the part of lambda that the state does not change
    RotorDecay half[kLevels];                // over half a classical step
    RotorDecay node[kLevels][kStages8 + 1];  // at the stages of a Dormand-Prince step; last: over the step
};
TickPlan make_tick_plan(const RigidBodyParams &params, double tick_s, int substeps);

struct TickWind {
    double start_W[3];
    double slope_W[3];  // per second
    bool changes;       // any slope not zero
};

// One tick without contact. `state` in and out; `command` the speeds that the rotors tend to; `phase` [n] of the rotors
// out of balance, in and out; `path` receives p and q after each step, [steps][7], room for substeps * 2^(kLevels-1)
// and 2^(kLevels-1) of them. `steps` receives their number. Returns the length of the polygon through the positions [m].
double free_flight_tick(const RigidBodyParams &params, const TickPlan &plan, const TickWind &wind,
                        const double *command, double *state, double *phase, double *path, int &steps);

}  // namespace hil::sim
