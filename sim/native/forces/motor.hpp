// Brushless motor of a rotor with its speed controller: current by voltage and speed, and what the battery delivers.
//
//   u   duty cycle 0..1: the command          V   voltage of the battery, held over a tick
//   O   speed >= 0 [rad/s]                    K   = 60 / (2 pi kv): torque per current and voltage per speed
//
//   current     I = x,  x = (u V - K O) / R                       a controller with active braking (complementary
//               switching): below its speed the motor is a generator, and u I < 0 charges the battery
//               I = (x + sqrt(x^2 + (u I_r)^2)) / 2               one that lets the rotor coast: its diodes block
//   battery     I_b = u I: the controller is a lossless transformer of the ratio u; its resistance counts in R
//   speed       J dO/dt = K I - K I_0 O / (O + O_f) - Q           Q the aerodynamic torque of the rotor
//
// Two-parameter motor with its no-load current (M. Drela, First-Order DC Electric Motor Model, MIT 2007): inductance and
// saturation are left out, as their times are far below the mechanical time constant J R / K^2. O_f makes the friction
// that the no-load current stands for vanish with the speed. I_r, a share of the current of a stalled motor, is that of
// discontinuous conduction, where the mean current ends gradually and not at x = 0. O_f and I_r are estimates.
//
// Deterministic: + - * / sqrt.
#pragma once

#include <cmath>

namespace hil::sim {

struct MotorParams {
    double torque_nm_per_a;    // K
    double resistance_ohm;     // R, with the speed controller's
    double no_load_current_a;  // I_0
    double nominal_voltage_v;  // V without a battery, and that of which a battery's voltage is a share
    bool braking;
};

inline constexpr double kFrictionSpeed_radps = 20.0;  // O_f
inline constexpr double kConductionShare = 0.02;      // I_r over V_nominal / R

struct MotorCurrent {
    double current_a;   // I
    double per_volt_s;  // dI/dV
};

inline MotorCurrent motor_current(const MotorParams &m, double duty, double voltage_v, double speed_radps) {
    const double x = (duty * voltage_v - m.torque_nm_per_a * speed_radps) / m.resistance_ohm;
    const double slope = duty / m.resistance_ohm;
    if (m.braking) return {x, slope};
    const double blur = duty * (kConductionShare * m.nominal_voltage_v / m.resistance_ohm);
    const double root = std::sqrt(x * x + blur * blur);
    return {0.5 * (x + root), root > 0.0 ? 0.5 * slope * (1.0 + x / root) : slope};
}

// Current that friction takes at a speed.
inline double friction_current_a(const MotorParams &m, double speed_radps) {
    return m.no_load_current_a * speed_radps / (speed_radps + kFrictionSpeed_radps);
}

}  // namespace hil::sim
