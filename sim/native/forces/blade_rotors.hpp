// Rotors by blade-element momentum theory: `rotor_model: blade_element`. Commands, speeds, faults, gyroscopic torque and
// imbalance are those of rotors.hpp; thrust, drag, moments and torque are these.
//
//   u   velocity of the hub through the air, u_n along the rotor's axis n, u_a across it, V = |u_a|
//   v   induced velocity aloft; at the rotor it is v' = (1 - gamma) v;  w = u_n + v'
//   r   density of the air over that for which the coefficients hold
//
// Thrust of blades with uniform inflow (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., ch. 3 and 5):
//   T = r (c_t O^2 + c_V p V^2 - c_l O w),   p = (O R)^2 / ((O R)^2 + V^2)
//   c_t = k + c_l sqrt(kappa), kappa = k / (2 rho pi R^2): T = k O^2 in hover;  c_V = 1.5 c_t / R^2
//   p takes edgewise flow out where most of the disc is in reverse flow.
// Induced velocity by momentum theory, with a closure for descent (Leishman's polynomial, ch. 2; Glauert in forward flight):
//   T = r 2 rho A v W
//   W^2 = V^2 + (u_n + v)^2 + u_n^2 v^6 (a v^2 + b u_n v + c u_n^2) / E^4,   E = v^2 + ((u_n + s v) / d)^2 + e V^2
//   1/d^2 = 1.21, s = 0.19, a = -1.24, b = 0.46, c = 2.73, e = 2: sim/physics/forces/rotor_equations.py says how good it is
//   One solution for every flow: vortex ring, windmill, reverse flow without a branch. It does not depend on r. Newton's
//   method, until a step is below 1e-8 of v, so that the next would be below the rounding.
// Ground, after Hayden (AHS Forum 32, 1976), bounded at the ground and faded out as in rotor_air.hpp:
//   (R of R_g there)  gamma = 2.43 f / (2.43 / gamma_0 + (4z/R)^2),  f = max(0, cos tilt)^4 (1 - (z/z_c)^2)^4 kappa O^2 / (kappa O^2 + V^2)
// Force across (flapping; induced and profile drag of the blades), and the share h of the blades' moments on the hub: lift
// of the advancing blade, and inflow that rises to the rear (White and Blake: v (1 + sqrt(2) sin chi (r/R) cos psi)):
//   H = -r (k_d O + c_V p w + 2 c_q O / R^2) u_a
//   M = -r h (s p (c_t O - c_l w / 2) u_a + sqrt(2) c_l v' O R / (4 W) n x u_a)
// Shaft power: the work done on the vehicle, and the losses:
//   Q O = T (u_n + kappa_i v') - |H| V + r c_q O (O^2 + 4.65 p V^2 / R^2),  c_q = k (m_ratio - kappa_i sqrt(kappa))
//   c_q is such that Q = m_ratio k O^2 in hover.
// Lower rotor of a coaxial pair: chi times the upper rotor's v is added to its u_n. chi is such that its static thrust at
// equal speeds is the share 1 - c_i of that alone.
//
// Limits of a step, besides those of rotors.hpp (instead of its last): (|dO/dt| + 0.5 |w| |u| / sqrt(kappa)) h <= 0.3 d, the
// second rate that of u_n in a descent of a body that turns with w, as a change of speed; d the distance from the speed O
// to the nearest singularity of the inflow as a function of complex O that was found by solving dT/dv = 0 numerically:
// where the vortex ring state turns into the windmill state, (0.5 |u_n| +- i (0.05 |u_n| + 0.2 V)) / sqrt(kappa);
// +-i sqrt(V^2 + u_n^2) / sqrt(kappa); and the pole of p, +-i V / R.
#pragma once

#include "blade_lanes.hpp"
#include "flow_rotors.hpp"

namespace hil::sim {

struct BladeParams {
    double inflow_thrust_kg_per_rad;       // c_l
    double translational_thrust_kg_per_m;  // c_V; below 0: that of theory
    double induced_power_factor;           // kappa_i
    double profile_power_growth;           // 4.65
    double hub_moment_share;               // h
    double ground_floor;                   // 2.43 / gamma_0; 0: no ground effect
    double density_ratio;                  // 1.225 kg/m3 over the density for which the coefficients hold
    double coaxial_wake;                   // chi
};

class BladeRotors : public FlowRotors {
  public:
    BladeRotors(const RotorsParams &rotors, const BladeParams &blades);

    void set_rotor(int rotor, double thrust_left, double forced_speed_radps, double imbalance_kgm) override;

    void turn(int rotor, const RotorPose &pose) override;
    void prepare(const StepTimes &times, const Inertia &inertia) override;
    double damping_per_s(double airspeed_mps) const override { return damping_per_s_ + edge_per_m_ * airspeed_mps; }
    double longest_step(const double *s, const double *wind_W, double longest_s) const override;
    void evaluate(const Instant &now) const override;
    void assemble(const Instant &now, Wrench &out) const override;

    // Induced velocity aloft of each rotor [m/s], and shaft torque [N m], of the last `add`.
    double induced_mps(int rotor) const { return lanes_.induced[lane_[rotor]]; }
    double torque_nm(int rotor) const { return lanes_.torque[lane_[rotor]]; }

  private:
    BladeParams b_;
    const BladeKernel &kernel_;
    int lane_[kMaxRotors];
    double edge_per_m_ = 0.0;
    mutable BladeLanes lanes_{};
};

}  // namespace hil::sim
