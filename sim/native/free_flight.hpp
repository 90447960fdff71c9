// Free flight of the rigid body of rigid_body.hpp over one tick with constant commands.
//
// The rotor equation is linear for a constant command, so its closed-form solution is evaluated at the stages of the
// integrator: rotors and body are consistent at every stage, and the motor lag does not reduce the order of the body.
// (p, q, v, w) are integrated by an explicit Runge-Kutta method, with q normalised after every step:
//
//   Dormand-Prince, order 8, 12 stages (Hairer, Norsett, Wanner, Solving ODEs I, 2nd ed., II.5), one step per tick of 4 ms
//   classical, order 4, for comparison
//
// One step of order 8 over 4 ms costs as much as four classical steps of 1 ms and is about a hundred times more
// accurate (`hil bench physics`). A vehicle that tumbles for an hour at 20 rad/s keeps its energy to 1e-13; the
// classical method at 1 ms would lose 1e-6 ((w h)^6 / 72 per step).
//
// Steps are halved, up to 64 times as many, until h satisfies these limits for the state at the tick's start:
//   |w| h <= 0.1          a turning vehicle                                (not the classical method)
//   |v| h <= 0.06 m       no contact is skipped: collisions are checked at the ends of steps (not the classical)
//   lambda h <= 2         the fastest damping and the gyroscopic rate, for stability of a light vehicle in a gale:
//                         lambda = 2 d2 |a| / m + d1 / m + (k_d + k_z) O_max (n / m + sum |r|^2 / I_min)
//                                  + n J O_max / I_min                                     (classical: lambda h <= 1)
//   h <= 2 tau            fast change of thrust                                    (not the classical)
//   O h <= 1              an unbalanced rotor
// and each step, also within the tick, until
//   |dO/dt| h <= 0.4 d    a rotor that starts in a descent or across the wind (not the classical); d is the distance from
//                         its speed O to the nearest pole of its thrust as a function of complex O (rotor_air.hpp):
//                         O = a / (x0 sqrt(kappa)) e^(+-i pi/4) of the vortex ring state, +-i V / sqrt(kappa)
// The choice depends only on the state: same bits on every machine, with contact skipping on or off.
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
    double static_rate_per_s;                // part of lambda that is independent of the state
    double lag_rate_per_s;                   // 1 / (2 tau)
    RotorDecay half[kLevels];                // over half a step
    RotorDecay node[kLevels][kStages8 + 1];  // at the stages of a step; last: over the step
};
TickPlan make_tick_plan(const RigidBodyParams &params, double tick_s, int base, bool classical);

struct TickWind {
    double start_W[3];
    double slope_W[3];  // per second
    bool changes;       // true if any slope is not zero
};

// Advances `state` by one tick without contact. `command`: steady speeds of the rotors. `phase` [n]: phases of
// unbalanced rotors, updated. `path` receives p and q after each step, [steps][7], and needs space for
// base * 2^(kLevels-1) steps. `steps` receives their number. Returns the length of the polygon through the positions [m].
double free_flight_tick(const RigidBodyParams &params, const TickPlan &plan, const TickWind &wind,
                        const double *command, double *state, double *phase, double *path, int &steps);

}  // namespace hil::sim
