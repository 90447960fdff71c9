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
// Motors (forces/motor.hpp) take their current directly: V = nE - R (sum u_i I_i(V) + (P / eta + P_0) / V) with the speeds
// and commands at the tick's start, and the charge of a tick is the integral of their current at this voltage. eta then
// says nothing of them.
//
// With a thermal model, the cells have one temperature T (lumped, as Bernardi, Pawlikowski and Newman, J. Electrochem.
// Soc. 132, 1985, without their entropic term), and the pack's resistance and capacity follow it:
//
//   resistance          R(T) = R_leads + R_cells e^{E/k (1/T - 1/T_ref)}                                (Arrhenius)
//   capacity            C(T) = C s(T),  s linear between the points of a table, constant beyond its ends
//   temperature         c dT/dt = I^2 R_cells(T) - h (T - T_a)
//
// R and C have their values at the start of a tick, I is its mean current; over the tick T then has the closed form
// T_inf + (T - T_inf) e^{-h t / c} with T_inf = T_a + I^2 R_cells / h. The heat of the leads goes into the air.
//
// Deterministic: + - * / sqrt and det::exp.
#pragma once

#include <cmath>
#include <limits>

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

inline constexpr double kZeroDegC_k = 273.15;

struct BatteryThermal {
    static constexpr int kMostPoints = 16;
    bool fitted = false;
    double cells_ohm = 0.0, leads_ohm = 0.0;  // at the reference; their sum is the resistance of the pack
    double reference_k = 298.15;
    double activation_k = 0.0;  // E/k
    double heat_capacity_j_per_k = 1.0, cooling_w_per_k = 1.0;
    double ambient_degc = 15.0;
    int points = 0;
    double table_degc[kMostPoints], table_share[kMostPoints];  // s(T), ascending

    double cells_ohm_at(double degc) const {
        return cells_ohm * det::exp(activation_k * (1.0 / (degc + kZeroDegC_k) - 1.0 / reference_k));
    }
    double capacity_share_at(double degc) const {
        if (points == 0) return 1.0;
        if (!(degc > table_degc[0])) return table_share[0];
        for (int i = 1; i < points; ++i) {
            if (degc > table_degc[i]) continue;
            const double part = (degc - table_degc[i - 1]) / (table_degc[i] - table_degc[i - 1]);
            return table_share[i - 1] + part * (table_share[i] - table_share[i - 1]);
        }
        return table_share[points - 1];
    }
    // Temperature after `time_s` with a constant current.
    double after(double degc, double current_a, double time_s) const {
        const double end = ambient_degc + current_a * current_a * cells_ohm_at(degc) / cooling_w_per_k;
        return end + (degc - end) * det::exp(-cooling_w_per_k * time_s / heat_capacity_j_per_k);
    }
    // The pack as it is at this temperature.
    BatteryParams pack_at(const BatteryParams &pack, double degc) const {
        BatteryParams now = pack;
        now.resistance_ohm = leads_ohm + cells_ohm_at(degc);
        now.capacity_c = pack.capacity_c * capacity_share_at(degc);
        return now;
    }
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

// Voltage at which the pack delivers this power and what forces take directly: the root of
//   g(V) = V - E + R (I(V) + P / V),   `supply(share, slope)` = I(V) and dI/dshare,  share = V / V_nominal
// g is convex, so Newton's method falls from above on the greater root. NaN without one.
template <class Supply>
double supplied_v(const BatteryParams &b, double drawn_c, double shaft_w, const Supply &supply) {
    constexpr int kMostSteps = 40;
    const double e = open_circuit_v(b, drawn_c), power_w = shaft_w / b.efficiency + b.auxiliary_w;
    double v = e;
    for (int k = 0; k < kMostSteps; ++k) {
        double slope = 0.0;
        const double current = supply(v / b.nominal_voltage_v, slope);
        const double over = v - e + b.resistance_ohm * (current + power_w / v);
        const double rise = 1.0 + b.resistance_ohm * (slope / b.nominal_voltage_v - power_w / (v * v));
        const double next = v - over / rise;
        if (!(rise > 0.0 && next > 0.0)) break;
        if (std::fabs(next - v) <= 1e-13 * v) return next;
        v = next;
    }
    return std::numeric_limits<double>::quiet_NaN();
}

// Integral of (c + l e^{-t/tau})^3 over [0, T], decay = e^{-T/tau}.
inline double cubed_speed_integral(double c, double l, double tau, double T, double decay) {
    const double d1 = 1.0 - decay;
    const double d2 = 1.0 - decay * decay;
    const double d3 = 1.0 - decay * decay * decay;
    return c * c * c * T + tau * l * (3.0 * c * c * d1 + l * (1.5 * c * d2 + l * d3 / 3.0));
}

}  // namespace hil::sim
