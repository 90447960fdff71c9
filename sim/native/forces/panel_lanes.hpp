// Loads of flat panels in lanes, four at a time, for panel_lanes.isa.cpp. Equations: panels.hpp.
//
// Lifting panels come first, then from the next multiple of 4 those of bodies, which neither induce velocities nor feel
// them. Lanes without a panel have no area; their loads are 0.
#pragma once

#include "slipstream.hpp"

namespace hil::sim {

inline constexpr int kLiftingLanes = 40, kPanelLanes = 64;

struct alignas(32) PanelLanes {
    using Lane = double[kPanelLanes];

    int lifting = 0, lanes = 0;  // multiples of 4

    // Of each panel, in B: where its velocity is taken, its middle, from there to the quarter chord; axes; m, m2.
    Lane seen[3], middle[3], ahead[3], x[3], y[3], z[3];
    Lane area, chord;
    // Section.
    Lane slope, zero_lift, stall_middle, stall_width8, reduced, drag, drag_of_lift, moment;  // stall_width8: h^8
    Lane plate;
    // W and W': [j][i], velocity at i by what j passes.
    double influence[kLiftingLanes][kLiftingLanes], tilting[kLiftingLanes][kLiftingLanes];
    double ground_per_m = 0.0, ground_fade_per_m2 = 0.0;  // 16 / b, 1 / (4 b)^2; 0: no ground effect

    // By the surfaces: the turn of the zero-lift line, sine and cosine of t, change of C_m.
    Lane bend, shift_sine, shift_cosine, flap_moment;
    bool bent = true;  // since sine and cosine were computed
    // At an instant: velocity of the body through the air, its rate, z of W in B, height, half the density.
    double air_B[3], w[3], up_B[3], height_m, half_density;
    bool near_ground;
    const Slipstreams *slipstreams;

    // Slipstreams whose places were last seen: for each panel k = 1 + x / sqrt(x^2 + R^2) and d^2.
    int seen_streams = 0;
    double seen_place[kMaxRotors][7];
    Lane grown[kMaxRotors], off2[kMaxRotors];

    // Results: force and moment about the centre of mass of each panel, and their sums.
    Lane force[3], torque[3];
    double all_force[3], all_torque[3];
    // Velocities in the panel's axes, and of the lifting panels what they pass to the others and what comes back.
    Lane along, across, through, passed, induced, tilted;
    Lane stirred;  // rate of the slipstreams at each panel by the speeds of their rotors: a bound for its step
};

struct PanelKernel {
    void (*loads)(PanelLanes &);
};

// The kernel of the best instruction set of this CPU.
const PanelKernel &panel_kernel();

}  // namespace hil::sim
