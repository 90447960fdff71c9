// Downwash: the mean wind that one multirotor's wake makes at another.
//
// The rotors' wakes merge into one turbulent jet, as Bauersfeld et al. measured from 2.5 vehicle diameters below a
// quadrotor (Robotics meets fluid dynamics: a characterization of the induced airflow below a quadrotor as a turbulent
// jet, IEEE RA-L 2025, arXiv 2403.13321). Here the jet starts at the speed of momentum theory's far wake, has a Gaussian
// profile, and spreads as a free round jet (Fischer et al., Mixing in Inland and Coastal Waters, 1979, ch. 9: 0.107):
//
//   F = sum T_i at no speed through the air, T = |F|,  A = sum of discs (of a coaxial pair one),  v_i = sqrt(T / (2 rho A))
//   u(z, r) = 2 v_i (b0 / b) exp(-r^2 / b^2) along -F,   b = b0 + 0.107 z,   b0 = sqrt(A / pi)
//
// b0 is such that the jet carries the thrust at every z: rho int u^2 dA = rho pi b^2 U^2 / 2 = T.
//
// z and r are measured along and across the jet's axis, which starts at the upper vehicle's centre. A jet is left behind
// by a vehicle that moves through the air: its axis points along -2 v_i F / T - a, a the velocity through the air
// (skew of the far wake in momentum theory). u is 0 for z <= 0, and beyond r = 3 b, where it is below 2e-4 of 2 v_i.
// The winds of several vehicles are added. The jet does not bend, decay in turbulence, or spread along the ground.
//
// Deterministic: + - * / sqrt and detmath.hpp only.
#pragma once

namespace hil::sim {

struct Jet {
    double origin_W[3];
    double axis_W[3];      // unit vector
    double velocity_W[3];  // 2 v_i, along -F
    double b0_m;
};

// Writes the jet of `discs` rotors of this radius that push the vehicle with `force_B`, in the wind `wind_W`. `s`: p, q, v,
// w of the vehicle; `induced2_per_n` = 1 / (2 rho pi R^2). Returns false if there is none.
bool jet_of(const double *s, const double *force_B, double induced2_per_n, double radius_m, int discs,
            const double *wind_W, Jet &out);

// Adds the jet's wind at `p_W` to `wind_W`.
void add_jet(const Jet &jet, const double *p_W, double *wind_W);

}  // namespace hil::sim
