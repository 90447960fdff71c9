// Effects of the air on one rotor's thrust: ground effect, descent into its own wake, axial inflow.
//
//   T = k O^2 G V - k_z O u_z
//
// u = air velocity at the hub in B (vehicle through air), v_h^2 = T_hover / (2 rho A) = kappa O^2 the induced velocity
// of momentum theory, kappa = k / (2 rho pi R^2).
//
// Ground, after Cheeseman and Bennett (ARC R&M 3021, 1955, eq. 6): T / T_inf = 1 / (1 - (R/4z)^2 / (1 + (V/v_h)^2)).
// It has a pole at z = R/4, so here the height has a lower limit and the effect is faded out:
//   G = 1 / (1 - s / (b + (4z/R)^2)),   b = G0 / (G0 - 1)
//   s = max(0, cos tilt)^4 (1 - (z/z_c)^2)^4  v_h^2 / (v_h^2 + V^2),   0 at and above z_c = 32 R
// R is here that of a rotor with the whole vehicle's effect, R_g. Far from the ground the images of n rotors add up to
// that of one with sqrt(n) times the radius, and the air that rises between them lifts the hull (Sanchez-Cuevas, Heredia
// and Ollero, Int. J. Aerospace Eng. 2017, 1823056, eq. 9): R_g is the radius of one rotor where a file does not say.
// G0 is the ratio at z = 0. For z >> R the result equals theirs up to (R/4z)^4; above z = R it is within 0.02 for
// G0 = 2. z is the hub's height over the ground plane; boxes have no ground effect.
//
// Descent: in the vortex ring state the thrust at given speed falls. With a = max(0, -u_z) the descent along the
// rotor's axis and V the speed across it,
//   V_loss = 1 - L 4 y / (1 + y)^2 (v_h^2 / (v_h^2 + V^2))^2,   y = (a / (x0 v_h))^4,   x0 = 1.45
// L is the greatest loss, at the descent where the induced velocity of momentum theory's empirical fit peaks (Leishman,
// Principles of Helicopter Aerodynamics, ch. 2: v_i/v_h = kappa - 1.125 x - 1.372 x^2 - 1.718 x^3 - 0.655 x^4, greatest
// at x = -1.45); it is halved at 0.93 and 2.25 v_h, and gone in the windmill state and in forward flight.
//
// Smooth: G and V have at least three continuous derivatives in all arguments (four in the fade), as the fourth-order
// integrator needs; both are bounded for every finite argument.
// Deterministic: + - * / and comparisons only.
#pragma once

namespace hil::sim {

inline constexpr int kMaxRotors = 8;  // of one vehicle

struct RotorAir {
    double kappa_m2;           // v_h^2 / O^2 [m2]
    double radius_m;           // R
    double ground_floor;       // b; 0: no ground effect
    double descent_loss;       // L in [0, 1); 0: none
    double axial_kg_per_rad;   // k_z; 0: none
    double ground_radius_m;    // R_g
};

inline constexpr double kGroundReachRadii = 32.0;
inline constexpr double kVortexRingCentre = 1.45;

// G. `height_m` of the hub over the ground, `up` = e_z of B times z of W.
inline double ground_ratio(const RotorAir &air, double height_m, double up, double induced2, double across2) {
    const double reach = kGroundReachRadii * air.ground_radius_m;
    const double fade = 1.0 - (height_m * height_m) / (reach * reach);
    if (!(fade > 0.0) || !(up > 0.0) || !(induced2 > 0.0)) return 1.0;
    const double up2 = up * up, fade2 = fade * fade;
    const double s = (up2 * up2) * (fade2 * fade2) * (induced2 / (induced2 + across2));
    const double z = 4.0 * height_m / air.ground_radius_m;
    return 1.0 + s / ((air.ground_floor - s) + z * z);
}

// V_loss. `axial` = u_z.
inline double descent_ratio(const RotorAir &air, double axial, double induced2, double across2) {
    if (!(axial < 0.0) || !(induced2 > 0.0)) return 1.0;
    const double a2 = axial * axial;
    const double a4 = a2 * a2;
    const double c2 = (kVortexRingCentre * kVortexRingCentre) * induced2;
    const double c4 = c2 * c2;
    const double sum = a4 + c4;
    const double calm = induced2 / (induced2 + across2);
    return 1.0 - air.descent_loss * (4.0 * (a4 / sum) * (c4 / sum)) * (calm * calm);
}

}  // namespace hil::sim
