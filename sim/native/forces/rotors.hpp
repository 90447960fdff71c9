// Rotors of a vehicle: thrust, torque, drag and gyroscopic moment of each, and their speeds. `rotor_model: quadratic`.
//
// Own states: speed O_i of each rotor [rad/s], >= 0. Commands: u_i of each.
//
// Equations (n_i the axis of rotor i in B, the direction of its thrust, r_i its place, spin s_i = +1 for a rotor turning
// counter-clockwise seen from above, u_i = a + w x r_i the velocity of its hub through the air, u_ni = u_i . n_i):
//   command      c_i = O_max (1 + e (V / V_nominal - 1)) sqrt(f u^2 + (1 - f) u),  u clamped to 0..1
//                f = 1: speed proportional to the command, thrust quadratic in it;  f = 0: thrust proportional.
//                (f is PX4's THR_MDL_FAC.) V / V_nominal is 1 without a battery: battery.hpp
//                e = 1: speed in proportion to the voltage. A motor without a speed controller slows down under its
//                load: with V = R I + K O and I rising with O^2, e = (K O + R I) / (K O + 2 R I), 0.5 to 1
//   speed        dO_i/dt = (c_i - O_i) / tau,  tau = tau_up if c_i > O_i else tau_down
//   thrust       T_i = (k_i O_i (O_i - c_i O_j) G_i V_i - k_z O_i u_ni) n_i                 (rotor_air.hpp)
//   rotor drag   H_i = -k_d O_i (u_i - u_ni n_i)
//   imbalance    U_i = b_i O_i^2 (cos phi_i e1_i + sin phi_i e2_i),  dphi_i/dt = s_i O_i    (a rotor with a lost blade)
//                e1_i = x_B - (x_B . n_i) n_i, normalised (z_B for a rotor along x);  e2_i = n_i x e1_i
//   force        sum T_i + H_i + U_i
//   torque       sum r_i x (T_i + H_i + U_i) - sum s_i m_i O_i^2 n_i - w x h - dh/dt,  h = sum s_i J O_i n_i
// Coaxial pair: the lower rotor i works in the wake of the upper rotor j, whose velocity is proportional to O_j. By blade
// element theory the thrust that it loses is proportional to its own speed and to that velocity, as with k_z. At equal
// speeds its thrust is the share 1 - c_i of that alone; c_i = 0 for any other rotor.
// Rotors that all have n_i = (0, 0, 1) and c_i = 0 take a shorter branch, `upright`.
// A rotor that a tilt turns with the rate t' about the axis a through the hinge c (tilts.hpp):
//   dn_i/dt = t' a x n_i,  u_i has t' a x (r_i - c) besides,  dh/dt has s_i J O_i dn_i/dt besides
// A rotor's reaction on the body is opposite to its spin: counter-clockwise rotors turn the body clockwise. Its torque
// m_i O_i^2 depends on its speed alone: the ground effect changes the thrust at a speed, not the power.
//
// Limits of a step h:
//   h <= 2 tau            fast change of thrust                                    (not the classical method)
//   O h <= 1              an unbalanced rotor
//   |dO/dt| h <= 0.4 d    a rotor that starts in a descent or across the wind (not the classical); d is the distance from
//                         its speed O to the nearest pole of its thrust as a function of complex O (rotor_air.hpp):
//                         O = a / (x0 sqrt(kappa)) e^(+-i pi/4) of the vortex ring state, +-i V / sqrt(kappa)
#pragma once

#include "force.hpp"
#include "rotor_air.hpp"

namespace hil::sim {

struct RotorsParams {
    int count;  // 1..kMaxRotors
    double position_m[kMaxRotors][3];
    double spin[kMaxRotors];  // +1 counter-clockwise seen from above, -1 clockwise
    double axis[kMaxRotors][3];  // n_i, unit vectors
    int above[kMaxRotors];    // j; its own index i without a rotor above
    double coaxial_loss[kMaxRotors];  // c_i
    double thrust_coefficient_n_per_radps2;
    double moment_ratio_m;
    double max_speed_radps;
    double thrust_model_factor;  // f
    double time_constant_up_s;
    double time_constant_down_s;
    double inertia_kgm2;
    double drag_kg_per_rad;
    double voltage_slope;  // e
    RotorAir air;
};

// Where a tilt has a rotor, in B.
struct RotorPose {
    double place_m[3], axis[3], plane[2][3];   // r, n, e1 and e2
    double place_rate_mps[3], axis_rate_per_s[3];
    double tilt_rate_radps;  // t'
};

class Rotors : public Force {
  public:
    explicit Rotors(const RotorsParams &params);

    // A tilt turns this rotor; its place is up to `reach_m` from the centre of mass. Before `prepare`. Returns its pose now.
    RotorPose let_tilt(int rotor, double reach_m);
    // Pose of such a rotor from here on.
    virtual void turn(int rotor, const RotorPose &pose);

    // State of a rotor from the next tick on; with a forced speed < 0 it follows its command.
    virtual void set_rotor(int rotor, double thrust_left, double forced_speed_radps, double imbalance_kgm);
    // Whether a rotor's motor is driven, from the next tick on. False if these rotors have no motors.
    virtual bool set_driven(int /*rotor*/, bool /*driven*/) { return false; }

    const RotorsParams &params() const { return p_; }
    int commands() const override { return p_.count; }
    int states() const override { return p_.count; }
    void prepare(const StepTimes &times, const Inertia &inertia) override;
    int command(const double *control, double voltage) override;
    void settle(double *own) const override;
    void begin_tick(const double *own) override;
    void end_tick(double *own) override;
    double step_rate_per_s(bool classical) const override;
    double damping_per_s(double) const override { return damping_per_s_; }
    double longest_step(const double *s, const double *wind_W, double longest_s) const override;
    void at(int level, int node, double t_s) override;
    void add(const Instant &now, Wrench &out) const override { assemble(now, out); }
    void end_step(int level, double h_s) override;
    void at_contact(const double *own, bool hard) override;
    void end_contact(double *own, bool hard) override;
    void at_instant(const double *own) override;
    double power_w(const Instant &now, const double *own) override;
    double work_j(const double *own_before) const override;
    bool jet(const double *s, const double *own, const double *wind_W, Jet &out) const override;
    double full_scale(int) const override { return p_.max_speed_radps; }
    void repair() override;

    // Parts of `add`, for motors (motor_rotors.hpp): nothing, and all.
    void evaluate(const Instant &) const {}
    void assemble(const Instant &now, Wrench &out) const;
    // Aerodynamic torque against the spin, of the last `evaluate`.
    double torque_nm(int i) const {
        return p_.moment_ratio_m * p_.thrust_coefficient_n_per_radps2 * thrust_left_[i] * (speed_[i] * speed_[i]);
    }

  protected:
    // e^{-dt/tau} for spin-up and spin-down.
    struct Decay {
        double up, down;
    };
    Decay decay_over(double dt_s) const;
    // That of a node; a level is filled where it is first used.
    const Decay &decay_at(int level, int node);
    // Acceleration of the hubs along their axes, all together, over a force of 1 N at each: a bound of it [1/kg].
    double mobility_per_kg(const Inertia &inertia) const;
    double tau_s(bool up) const { return up ? p_.time_constant_up_s : p_.time_constant_down_s; }
    double phase_at(int i, double t_s, double lag) const;
    void push(int i, double t_s, double lag);
    void add_upright(const Instant &now, Wrench &out) const;
    void add_tilted(const Instant &now, Wrench &out) const;
    // Publishes the slipstream of rotor `i` with the velocity `induced_mps` at its disc.
    void publish(int i, double induced_mps, const Instant &now) const;
    // Publishes those of all rotors by momentum theory along the axis, with the speed U in every direction:
    //   v = sqrt(U^2 / 4 + v_h^2) - U / 2,  v_h^2 = kappa O^2
    void publish_all(const Instant &now) const;
    // Adds the force of unbalanced rotors.
    void add_imbalance(Wrench &out) const;
    // Adds the torque of the rotors' own spin: -w x h - dh/dt.
    void add_gyroscopic(const double *w, Wrench &out) const;

    // Velocity of the hub of rotor `i` through the air.
    void hub_velocity(int i, const double air[3], const double *w, double u[3]) const {
        point_velocity(air, w, p_.position_m[i], u);
        if (!tilting_) return;
        for (int j = 0; j < 3; ++j) u[j] += place_rate_[i][j];
    }
    // Greatest rate of a tilt [rad/s].
    double tilt_rate_radps() const;

    RotorsParams p_;
    bool upright_ = true, tilting_ = false;
    double reach_m_[kMaxRotors] = {};  // read if tilting
    double tilt_rate_[kMaxRotors] = {}, place_rate_[kMaxRotors][3] = {}, axis_rate_[kMaxRotors][3] = {};
    double plane_[kMaxRotors][2][3];  // e1_i, e2_i
    Decay node_[kLevels][StepTimes::kMaxNodes], contact_[kContactKinds], tick_;
    StepTimes times_{};
    bool filled_[kLevels] = {};
    double tick_s_ = 0.0, contact_s_[kContactKinds] = {};
    double damping_per_s_ = 0.0, lag_rate_per_s_ = 0.0;
    int nodes_ = 0;

    // Faults.
    double thrust_left_[kMaxRotors];  // k_i = thrust_left k, m_i = thrust_left m_ratio k
    double forced_speed_radps_[kMaxRotors];
    double imbalance_kgm_[kMaxRotors];  // b_i
    bool imbalanced_ = false;           // any b_i > 0

    // A tick. With a constant command each speed is monotone, so the choice of tau_up or tau_down is made once.
    double command_[kMaxRotors] = {};
    bool up_[kMaxRotors] = {};
    double lag_[kMaxRotors] = {};    // O - c at the start of the step
    double rate_[kMaxRotors] = {};   // -1 / tau
    double phase_[kMaxRotors] = {};  // at the start of the step
    double fastest_ = 0.0;           // greatest speed of an unbalanced rotor in this tick

    // Of the last `at`.
    double speed_[kMaxRotors] = {};
    mutable double accel_[kMaxRotors] = {};
    double push_x_[kMaxRotors] = {}, push_y_[kMaxRotors] = {};  // U_i along e1_i and e2_i; read only if imbalanced
};

}  // namespace hil::sim
