// Ideal flight controller of a multirotor, one tick at a time: equations and their reasons are in the headers of
// hil/run/stepped/ideal_controller.py and allocation.py, whose names are used here.
//
// World W is ENU, body B is FLU, SI units. + - * / sqrt and detmath.hpp only: the same bits on every machine.
// No allocation.
#pragma once

#include "forces/rotor_air.hpp"

namespace hil::sim {

// Inverse of a rotor geometry, and the range of a rotor's thrust.
struct Allocation {
    int rotors;
    double mix[kMaxRotors][4];  // thrust of a rotor per roll, pitch, yaw torque and collective thrust
    double least_n, most_n;
    double raised_n;  // collective thrust up to which torques may raise it
};

// Thrusts of the rotors for torques about x, y, z and a collective thrust.
void allocate(const Allocation &allocation, const double wanted[4], double *thrust_n);

struct ControllerParams {
    Allocation allocation;
    double columns[kMaxRotors][4];  // roll, pitch, yaw torque and thrust along z per newton of a rotor
    double reaction_nm_per_radps[kMaxRotors];  // torque about z of a change of speed within a tick
    double dt_s, gravity_mps2, mass_kg, inertia_kgm2[3];
    double thrust_coefficient, max_speed_radps, curve;
    double hover_n, most_thrust_n, most_yaw_accel;
    double lead_up, lead_down, decay_up, decay_down, fade, yaw_share;
};

struct ControllerGains {
    double position[3], velocity[3], attitude[3], rate[3];
};

// Set-point, as hil.run.stepped.setpoint.Setpoint.
struct Target {
    enum Level { kPosition, kVelocity, kAttitude, kRates, kRotors } level = kRotors;
    enum Height { kHeight, kClimb, kThrust } height = kThrust;
    bool turns = true;  // yaw is a rate
    double level_value[2] = {}, height_value = 0.0, yaw_value = 0.0;
    double speed_limit_mps = 0.0;
    double rotors[kMaxRotors] = {};
};

// True state of a vehicle.
struct Flown {
    const double *p_WB, *q_WB, *v_WB_W, *w_WB_B, *a_WB_W, *alpha_WB_B, *rotor_speed_radps;
    bool in_contact;
};

class IdealController {
  public:
    ControllerParams params{};
    ControllerGains gains{};
    Target target{};

    void reset();
    // Writes the command 0..1 of every rotor until the next tick.
    void step(const Flown &truth, double *commands);
    double press() const { return press_; }

  private:
    void forget_disturbance();
    void fade_disturbance();
    void observe(const Flown &truth, const double *R, const double *gyroscopic);
    void force(const Flown &truth, double *out);
    double hold_height(const Flown &truth);
    void press_down(const Flown &truth, double climb_mps);
    void tilt_rates(const double *R, const double *force, double *out) const;
    double yaw_rate(const double *R, double wz);
    void direct(const double *wanted, double *commands);
    void to_commands(const double *thrust_n, double *commands);

    bool fresh_ = true, flown_ = false;  // flown: squares_ are those of the last tick
    double speeds_[kMaxRotors] = {}, squares_[kMaxRotors] = {};
    double spin_up_nm_ = 0.0, yaw_torque_nm_ = 0.0, made_n_ = 0.0, missing_n_ = 0.0;
    double d_[3] = {}, e_[3] = {};
    double press_ = 0.0, touched_s_ = 0.0;
    bool yaw_locked_ = false, height_locked_ = false;
    double locked_yaw_ = 0.0, locked_z_m_ = 0.0;
};

}  // namespace hil::sim
