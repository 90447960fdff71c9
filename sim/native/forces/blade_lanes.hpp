// Rotors of the blade-element momentum model in lanes, four at a time, for blade_lanes.isa.cpp. Equations:
// blade_rotors.hpp.
//
// Lanes of upper rotors, and of rotors alone, come first, then from the next multiple of 4 those of lower rotors of
// coaxial pairs. Lanes without a rotor have coefficients of 0 and a disc and radius of 1; their loads are 0.
#pragma once

namespace hil::sim {

inline constexpr int kBladeLanes = 12;  // 8 rotors: for every division into upper and lower

struct alignas(32) BladeLanes {
    using Lane = double[kBladeLanes];

    int uppers = 0, lanes = 0;  // multiples of 4
    int above[kBladeLanes];     // lane of the upper rotor; read from `uppers` on

    // Of each rotor: place and axis in B, spin, coefficients; those of thrust also over 2 rho A.
    Lane r[3], n[3], spin, c_t, c_l, c_v, c_q, kappa, t_disc, l_disc, v_disc, wake;
    // Shared.
    double radius_m = 1.0, k_d = 0.0, induced_power_factor = 1.0, profile_power_growth = 0.0, hub_moment_share = 0.0;
    double ground_floor = 0.0;  // 0: no ground effect
    double ground_radius_m = 1.0;

    bool drifts = false;  // hubs move in B with `drift`: tilts turn them
    Lane drift[3];

    // At an instant: speeds, and of the body velocity through the air, body rate, z of W in B, height, density ratio.
    Lane speed;
    double air_B[3], w[3], up_B[3], height_m, density_ratio;

    // Results: force and moment about the centre of mass, shaft torque against the spin, velocity induced aloft.
    Lane force[3], moment[3], torque, induced;
};

struct BladeKernel {
    void (*loads)(BladeLanes &);
};

// The kernel of the best instruction set of this CPU.
const BladeKernel &blade_kernel();

}  // namespace hil::sim
