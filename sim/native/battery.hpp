// Lithium-polymer pack: voltage under load, and charge drawn by the rotors.
//
//   cell, open circuit  E(z) = 3.685 + 0.2156 z - 0.1178 z^2 + 0.3201 z^3 - 1.031 e^{-35 z}  [V],  z = 1 - Q / C
//     (Chen and Rincon-Mora, IEEE Trans. Energy Conversion 21, 2006, eq. 2)
//   pack                V = n E - R I,  V I = P / eta + P_0
//     hence             V = (nE + sqrt((nE)^2 - 4 R (P / eta + P_0))) / 2
//   shaft power         P = sum m_i O_i^3,  m_i the rotor's torque coefficient
//
// During a tick the voltage that scales the rotors' speed keeps its value at the start (a speed controller latches its
// duty cycle with the command), so commands are constant within a tick. The charge drawn over the tick, with each
// rotor's speed O = c + l e^{-t/tau}, is an integral in closed form.
//
// Deterministic: + - * / sqrt and det::exp.
#pragma once

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

struct BatteryParams {
    bool fitted = false;
    double cells = 0.0;
    double capacity_c = 0.0;  // coulomb
    double resistance_ohm = 0.0;
    double efficiency = 1.0;       // electrical to shaft
    double auxiliary_w = 0.0;      // P_0
    double nominal_voltage_v = 0.0;  // voltage at which rotors reach max_speed_radps
};

inline double open_circuit_v(const BatteryParams &b, double drawn_c) {
    const double z = 1.0 - drawn_c / b.capacity_c;
    return b.cells * ((3.685 + z * (0.2156 + z * (-0.1178 + z * 0.3201))) - 1.031 * det::exp(-35.0 * z));
}

// NaN if the pack cannot deliver the power.
inline double loaded_v(const BatteryParams &b, double drawn_c, double shaft_w) {
    const double e = open_circuit_v(b, drawn_c);
    return 0.5 * (e + std::sqrt(e * e - 4.0 * b.resistance_ohm * (shaft_w / b.efficiency + b.auxiliary_w)));
}

// Integral of (c + l e^{-t/tau})^3 over [0, T], decay = e^{-T/tau}.
inline double cubed_speed_integral(double c, double l, double tau, double T, double decay) {
    const double d1 = 1.0 - decay;
    const double d2 = 1.0 - decay * decay;
    const double d3 = 1.0 - decay * decay * decay;
    return c * c * c * T + tau * l * (3.0 * c * c * d1 + l * (1.5 * c * d2 + l * d3 / 3.0));
}

}  // namespace hil::sim
