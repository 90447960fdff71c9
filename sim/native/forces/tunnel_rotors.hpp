// Rotors by the coefficients that a wind tunnel measures over the advance ratio: `rotor_model: wind_tunnel`. Commands,
// speeds, faults, gyroscopic torque and imbalance are those of rotors.hpp.
//
//   J = u_n / (n D) = pi u_n / (O R)        u_n the velocity of the hub through the air along the rotor's axis
//   C_T(J) = C_T(0) (1 + t_1 J + t_2 J sqrt(J^2 + e^2))           e = 0.1
//   C_P(J) = C_P(0) (1 + q_1 J + q_2 J^2)
//
// The static coefficients are those of the file: C_T(0) stands for k, C_P(0) for m_ratio k. With these forms thrust and
// torque exist for a rotor that stands, as n^2 C_T and n^2 C_P have no power of n below 0 in them:
//   T = r k (O (O - c_i O_j) G + t_1 U O + t_2 U sqrt(U^2 + e^2 O^2)),   U = pi u_n / R
//   Q = r m_ratio k (O^2 + q_1 U O + q_2 U^2)
// r the density of the air over that for which the constants hold, G the ground effect of rotor_air.hpp, c_i the loss in
// the wake of an upper rotor of rotors.hpp.
//
// Outside of what was measured (0 <= J <= 0.8, say) these are extensions. Windmill, J above that of no thrust: the same
// forms. Reverse flow, J < 0: thrust goes on to grow, as of a disc in a flow (for |J| >> e the last term is t_2 J |J|);
// C_P falls, to autorotation. No vortex ring state.
// Edgewise flow, V across the axis: thrust and torque do not see it (a tunnel along the axis says nothing), so there is
// no translational lift and no hub moment; the force across is that of rotors.hpp, r k_d O V.
//
// Limits of a step, besides those of rotors.hpp without descent: (|w| |u| + g) h <= 0.5 sqrt(u_n^2 + (e O R / pi)^2), the
// rate of u_n of a body that turns and falls, and its distance from where the thrust bends.
#pragma once

#include "flow_rotors.hpp"

namespace hil::sim {

struct TunnelParams {
    double thrust_slope, thrust_bend;  // t_1, t_2, each <= 0
    double torque_slope, torque_bend;  // q_1, q_2
    double density_ratio;              // 1.225 kg/m3 over the density for which the constants hold
};

class TunnelRotors : public FlowRotors {
  public:
    TunnelRotors(const RotorsParams &rotors, const TunnelParams &tunnel);

    void prepare(const StepTimes &times, const Inertia &inertia) override;
    double damping_per_s(double airspeed_mps) const override { return damping_per_s_ + edge_per_m_ * airspeed_mps; }
    double longest_step(const double *s, const double *wind_W, double longest_s) const override;
    void evaluate(const Instant &now) const override;
    void assemble(const Instant &now, Wrench &out) const override;

    double torque_nm(int i) const { return torque_[i]; }

  private:
    TunnelParams t_;
    double edge_per_m_ = 0.0;
    mutable double torque_[kMaxRotors] = {};
    mutable double force_[kMaxRotors][3] = {};
};

}  // namespace hil::sim
