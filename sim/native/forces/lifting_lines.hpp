// Velocities that lifting panels induce at each other, as one matrix: a vortex lattice with one row of panels, solved once.
//
// Each panel i carries a horseshoe vortex (Katz and Plotkin, Low-Speed Aerodynamics, 2nd ed., 12.1 to 12.3): bound along its
// quarter-chord line, trailing along -x_B. Seen at the points at three quarters of the chords, with v_i the velocity of
// the air through panel i along its normal:
//   sum_j A_ij G_j = v_i,   A_ij = -(velocity at i of G_j = 1) . z_i
// A section of lift slope a instead of 2 pi has its A_ii raised by 2 / (a c_i) - 1 / (pi c_i): then the lift of a section
// that feels v_i - w_i is that of its vortex (Kutta, Joukowsky) where
//   G_i = a_i c_i (v_i - w_i) / 2,   w = (1 - diag(2 / (a c)) A^-1) v =: W v
// c_i is the chord across the quarter-chord line. W has no unit and holds at every speed.
//
// The lift leans back with the velocity at the vortex itself, at a quarter of the chord, without that of its own bound part:
//   w' = W' v,  W' = B A^-1,   B_ij = -(velocity at the quarter chord of i of G_j = 1) . z_i
// With it the induced drag is that of the wake far behind (Katz and Plotkin, 12.2); w at three quarters would give a fifth more.
// The points are those of the middle angle k of the panel, where y = sin(k) of the half's length: so the lattice of three
// panels has the lift and the induced drag of the finest within 1 % (Lan, J. Aircraft 11, 1974, on the same choice of points).
//
// Behind another wing its sheet is not concentrated in lines: its vortices have the core e = (d / 2) x / sqrt(x^2 + 4 d^2),
// d the width of the panel, x the distance behind it; wings that meet, a tailplane and its fin, have none for each other. Without wake
// roll-up and at the angle of attack 0 of the vehicle: the wake leaves along the body.
//
// Deterministic: + - * / sqrt, fixed order; Gauss's elimination with pivots of columns.
#pragma once

#include <vector>

namespace hil::sim {

struct LiftingLine {
    double left_m[3], right_m[3];  // ends of the quarter-chord line
    double quarter_m[3], seen_m[3];  // points of the panel at one and three quarters of the chord
    double normal[3];
    double chord_m, slope_per_rad;
    int wing;
    int sheet;  // panels of the same number have no cores for each other
};

// Writes W and W', row by row [n][n]. Throws std::invalid_argument if panels coincide.
void influence(const std::vector<LiftingLine> &panels, std::vector<double> &seen, std::vector<double> &tilting);

}  // namespace hil::sim
