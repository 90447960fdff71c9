// Free flight of the body of body.hpp over one tick with constant commands.
//
// Own states of the forces (rotor speeds) are evaluated in closed form at the stages of the integrator (forces/force.hpp).
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
//   |v| h <= 0.25 m       a vehicle in the ground's effect. Contacts need no limit: they are looked for in between
//                         (vehicle_physics.py)                             (not the classical)
//   lambda h <= 2         the fastest damping and gyroscopic rate, for stability of a light vehicle in a gale: the sum of
//                         damping_per_s of the forces                        (classical: lambda h <= 1)
//   rate h <= 1           step_rate_per_s of every force
// and each step, also within the tick, to what longest_step of every force allows (not the classical).
// The choice depends only on the state: same bits on every machine, with contact skipping on or off.
//
// Wind within the tick: wind(t) = start + t slope.
#pragma once

#include "body.hpp"

namespace hil::sim {

struct TickWind {
    double start_W[3];
    double slope_W[3];  // per second
    bool changes;       // true if any slope is not zero
};

// Advances `state` by one tick without contact; the forces hold the commands. `path` receives p and q after each step,
// [steps][7], and needs space for base * 2^(kLevels-1) steps. `steps` receives their number. Returns the length of the
// polygon through the positions [m].
double free_flight_tick(const Body &body, const StepTimes &times, const TickWind &wind, double *state, double *path,
                        int &steps);

}  // namespace hil::sim
