// Slipstreams of the rotors of a body: what one force tells the forces after it in the list, at the same instant.
//
// A rotor's slipstream runs straight along -n from its disc. With x the distance behind the disc (below 0 ahead of it) and
// d that from its axis, v the velocity induced at the disc, u_n and V the velocities of the hub through the air along the
// axis and across it:
//   velocity      k v,  k = 1 + x / sqrt(x^2 + R^2)         vortex tube (McCormick, Aerodynamics of V/STOL Flight, ch. 4)
//   contraction   (r / R)^2 = (E + v^2) / (E + k v^2),  E = u_n^2 + V^2 + V_1^2
//                 that of continuity, 1 / k without motion and 1 at speed; in between up to 0.14 wider than
//                 (u_n + v) / (u_n + k v), which has a pole in descent
//   edge          1 / (1 + (d / r)^8)
//   skew          w^2 / (w^2 + V^2 + V_1^2), w = u_n + v: a stream that the flow across blows away reaches nothing
// V_1 = 2 m/s keeps them smooth where a propeller starts or slides backwards through its own stream.
// The product is the velocity of the air along -n that is added. Not modelled: swirl, turbulence, the bend of the stream,
// what the vehicle's parts do to it.
//
// Only a body with a force that asks for them (Force::feels_slipstreams) has its rotors publish them.
#pragma once

#include "rotor_air.hpp"

namespace hil::sim {

struct Slipstream {
    double place_m[3];  // of the disc
    double axis[3];     // n
    double radius_m;
    double induced_mps;  // v
    double axial_mps;    // u_n
    double across2;      // V^2
    double rate_mps2;    // |dv/dt| by the speed of the rotor
};

struct Slipstreams {
    int count = 0;
    Slipstream of[kMaxRotors];
};

}  // namespace hil::sim
