// Aerodynamic forces of an aircraft by panels: wings, tails, control surfaces and fuselage, over all angles of attack and
// sideslip. `kind: panels`.
//
// A panel is a part of the span of a wing, flat, with axes x along the chord to the front and across the quarter-chord
// line, z its normal, y along the line. Its velocity through the air u = a + w x r is taken at three quarters of its chord
// (Pistolesi), with the slipstreams of the rotors (slipstream.hpp); v = -u . z is the velocity of the air through it.
//
// Section, t the shift of its zero-lift line:
//   t       tan(t / 2) = (sum e d - alpha_0) / 2,  d the deflections of its surfaces, e = tau eta times the share of the
//           panel's width that the surface takes; tau by thin aerofoil theory: 1 - (k - sin k) / pi, cos k = 2 E - 1, E the
//           share of the chord (McCormick, Aerodynamics, Aeronautics and Flight Mechanics, 2nd ed., ch. 3)
//   s, c    sine and cosine of the angle to the zero-lift line, of (u_x, v - w) turned by t; V^2 = u_x^2 + (v - w)^2 + V_0^2
//   f       share of attached flow: f = (1 + c)^2 (2 - c) / 4 / (1 + ((s - m) / h)^8)
//           1/2 at the stall's two angles m +- h, which are such that the section has the greatest and least lift given;
//           0 in flow from behind
//   attached      C_l = a s,  C_d = C_d0 + k C_l^2,  C_m = f (C_m0 + sum C_md d - a q c / 16 V) about the quarter
//                 chord, q = -w . y the rate nose up: thin aerofoil theory of a section that turns (-pi / 8 q c / V)
//   separated     C_n = C_90 s / (0.56 + 0.44 |s|) along the normal (Lindenburg, ECN-C--03-025, 2003, eq. 9);
//                 of a body: C_90 s |s|, cross flow (Hoerner, Fluid-Dynamic Drag, 3.11)
//   blend         C_l = f a s + (1 - f) C_n c,  C_d = C_d0 + f k (a s)^2 + (1 - f) C_n s
//   centre        (c_x / 4) ahead of the middle of the chord, c_x = u_x / V: at 1/4 of the chord attached, 1/2 at 90
//                 degrees, 3/4 in flow from behind (Hoerner; Khan and Nahon, Modeling dynamics of agile fixed-wing UAVs, 2016,
//                 take the same ends)
//   force         (r V S / 2) (C_l (v - w') - C_d u_x, -C_d0 u_y, C_l u_x + C_d (v - w')):  lift across the local flow
// |s| is sqrt(s^2 + 0.05^2). V_0 = 0.3 m/s makes the equations smooth at rest; above 3 m/s it changes the forces by less
// than 0.5 %. Separated flow of control surfaces: the same t.
//
// Induced velocities w and w' of the wings and tails on themselves and each other, with them lift slope, induced drag,
// downwash on the tail, and the damping of a roll: w = g W (f v_t), w' = g W' (f v_t), W and W' by lifting_lines.hpp,
// v_t = v cos t + u_x sin t. Here f is that of
// an estimate of the section's own angle, s times 1 - sum W_ij over its own wing: stalled panels induce nothing, and the
// downwash falls with the wing's stall. It acts without a delay, and the wake stays at its place in B.
//   g = 1 - (1 - (z / 4b)^2)^4 / (1 + (16 z / b)^2), ground effect: z height of the panel over the ground plane, b the
//       greatest span of a wing (McCormick, ch. 4; here faded out at 4 b, where his is 0.9998)
//
// Not modelled: unsteady lift (Wagner, dynamic stall), the delay of the downwash (C_m alpha-dot), Munk's moment of a
// fuselage, the fuselage's effect on wings, gaps, compressibility.
//
// Smooth: every function above has its singularities at least 0.38 h (0.1 rad) or 0.3 m/s from real flight.
//
// Limits of a step, besides those of servos.hpp: the flow at a panel turns by at most 0.05 rad,
//   (|w| + A / V) h <= 0.05,  V the least speed of a panel across its span, A = 20 m/s2: gravity, and as much again
// and, by what is known at the start of the step, for each panel with its own V, slipstreams included:
//   (|w| + A / V) h <= 0.04 (1 + (3 m/s / V)^2)^(1/8),   A = |dv/dt| + |dw/dt| |r| + s + max |dv_i/dt| / 2
//       s the rate at which the slipstreams at this panel change with the speeds of their rotors, v_i the velocity
//       induced at a rotor, whose thrust changes dv/dt as fast. The last factor: a panel in slow air has a force as V^2,
//       and the error of a step grows with the ninth power of the turn
//   lambda h <= 2,            lambda = sum over the panels of (rho_0 / 2) V S (a + 2 C_90 + C_d0) (1 / m + r^2 / I_least)
// The classical method, which does not ask for these, has lambda with the airspeed and 30 m/s of slipstream for V.
#pragma once

#include <vector>

#include "panel_lanes.hpp"
#include "surfaced_force.hpp"

namespace hil::sim {

// Effect of a surface on a panel, per radian: below 0 where it moves against its deflection.
struct PanelFlap {
    int surface;
    double angle, moment;  // of the zero-lift line (e), C_md
};

struct PanelParams {
    double left_m[3], right_m[3];  // ends of the quarter-chord line; +y_B is left
    double quarter_m[3];           // point of that line for which the panel stands
    double ahead_m[3];             // a quarter of the chord, along it
    int wing;                      // index; -1: a plate of a body
    int sheet;                     // of vortices: the same for wings that meet
    double lift_slope_per_rad, zero_lift_rad, stall_middle, stall_half_width;  // a, alpha_0, m, h
    double drag, drag_of_lift, moment, plate;                                  // C_d0, k, C_m0, C_90
    std::vector<PanelFlap> flaps;
};

class Panels : public SurfacedForce {
  public:
    // `ground_span_m`: b; 0: no ground effect.
    Panels(const std::vector<PanelParams> &panels, const std::vector<ServoParams> &surfaces, double ground_span_m);

    bool feels_slipstreams() const override { return true; }
    void prepare(const StepTimes &times, const Inertia &inertia) override;
    double damping_per_s(double airspeed_mps) const override;
    double longest_step(const double *s, const double *wind_W, double longest_s) const override;
    double longest_step_by_rates(const double *s, const double *ds, double longest_s) const override;
    void add(const Instant &now, Wrench &out) const override;

    int count() const { return static_cast<int>(lane_.size()); }
    int lane(int panel) const { return lane_[panel]; }
    const PanelLanes &lanes() const { return lanes_; }

    // Force and moment at these deflections, clear of the ground and of slipstreams.
    void wrench_of(const double air_B[3], const double w[3], const double *deflection_rad, double density_ratio,
                   Wrench &out) const;

  private:
    void deflect(const double *angle, bool healthy) const;

    const PanelKernel &kernel_;
    struct Flap {
        int lane, surface;
        double angle, moment;
    };

    std::vector<int> lane_;
    std::vector<Flap> flaps_;
    mutable double seen_rad_[kMaxSurfaces] = {};  // deflections for which the lanes are shifted
    double damping_per_m_ = 0.0, ground_reach_m_ = 0.0, reach_m_ = 0.0;
    mutable PanelLanes lanes_{};
    bool classical_ = false;
    mutable double wash_rate_mps2_ = 0.0;  // greatest |dv_i/dt|
    double arm_m_[kPanelLanes] = {};       // of each panel from the centre of mass
    double per_m_[kPanelLanes] = {};       // damping that each panel adds, over its speed
};

}  // namespace hil::sim
