// Free flight of the rigid body of rigid_body.hpp over one tick with constant commands.
//
// The rotor equation is linear with a constant command, so it is solved in closed form and evaluated at the stages of
// the integrator: rotors and body are consistent at every stage, and the body's order is not lost to the lag.
// (p, q, v, w) go by an explicit Runge-Kutta method, q renormalised after every step:
//
//   Dormand-Prince, order 8, 12 stages (Hairer, Norsett, Wanner, Solving ODEs I, 2nd ed., II.5), one step a tick of 4 ms
//   classical, order 4, to compare with
//
// Why order 8: at the cost of four classical steps of 1 ms, one step of 4 ms is some hundred times more accurate
// (`hil bench physics`), and a vehicle that tumbles for an hour keeps its energy to 1e-9, where the classical method at
// 1 ms would lose 1e-6 ((w h)^6 / 72 a step).
//
// Steps are halved, up to 64 times as many, until h is short enough for what the state says at the tick's start:
//   |w| h <= 0.1          a turning vehicle                                (not the classical method)
//   |v| h <= 0.06 m       no contact is stepped over; collisions are looked for at the steps' ends (not the classical)
//   lambda h <= 2         the fastest damping and the gyroscopic rate, so that a light vehicle in a gale stays stable:
//                         lambda = 2 d2 |a| / m + d1 / m + (k_d + k_z) O_max (n / m + sum |r|^2 / I_min)
//                                  + n J O_max / I_min                                     (classical: lambda h <= 1)
//   h <= 2 tau            thrust that changes much within a step                   (not the classical)
//   O h <= 1              a rotor out of balance
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
    bool classical;
    int base;                                // steps of a tick, before any halving
    double static_rate_per_s;                // the part of lambda that the state does not change
    double lag_rate_per_s;                   // 1 / (2 tau)
    RotorDecay half[kLevels];                // over half a step
    RotorDecay node[kLevels][kStages8 + 1];  // at the stages of a step; last: over the step
};
TickPlan make_tick_plan(const RigidBodyParams &params, double tick_s, int base, bool classical);

struct TickWind {
    double start_W[3];
    double slope_W[3];  // per second
    bool changes;       // any slope not zero
};

// One tick without contact. `state` in and out; `command` the speeds that the rotors tend to; `phase` [n] of the rotors
// out of balance, in and out; `path` receives p and q after each step, [steps][7], with room for base * 2^(kLevels-1).
// `steps` receives their number. Returns the length of the polygon through the positions [m].
double free_flight_tick(const RigidBodyParams &params, const TickPlan &plan, const TickWind &wind,
                        const double *command, double *state, double *phase, double *path, int &steps);

}  // namespace hil::sim
