#include "motor_rotors.hpp"

#include "rotor_bindings.hpp"
#include "tunnel_rotors.hpp"

namespace hil::sim {

namespace {

template <class Model>
void bind(nb::module_ &m, const char *name) {
    using Driven = MotorRotors<Model>;
    nb::class_<Driven, Model>(m, name, "Rotors with motors; see forces/motor_rotors.hpp.")
        .def(
            "__init__",
            [](Driven *self, const Model &rotors, double speed_per_volt_radps, double resistance_ohm,
               double no_load_current_a, double nominal_voltage_v, bool braking) {
                new (self) Driven(
                    rotors, {1.0 / speed_per_volt_radps, resistance_ohm, no_load_current_a, nominal_voltage_v, braking});
            },
            "rotors"_a, nb::kw_only(), "speed_per_volt_radps"_a, "resistance_ohm"_a, "no_load_current_a"_a,
            "nominal_voltage_v"_a, "braking"_a, "The rotors of `rotors`, each with this motor; see MotorParams.");
}

}  // namespace

void bind_motor_rotors(nb::module_ &m) {
    nb::class_<TunnelRotors, Rotors>(m, "TunnelRotors", "Rotors by wind-tunnel coefficients; see forces/tunnel_rotors.hpp.")
        .def(
            "__init__",
            [](TunnelRotors *self, const Rotors &rotors, double thrust_slope, double thrust_bend, double torque_slope,
               double torque_bend, double density_ratio) {
                new (self) TunnelRotors(rotors.params(),
                                        {thrust_slope, thrust_bend, torque_slope, torque_bend, density_ratio});
            },
            "rotors"_a, nb::kw_only(), "thrust_slope"_a, "thrust_bend"_a, "torque_slope"_a, "torque_bend"_a,
            "density_ratio"_a, "The rotors of `rotors`, with these coefficients; see TunnelParams.");
    bind<Rotors>(m, "MotorRotors");
    bind<BladeRotors>(m, "MotorBladeRotors");
    bind<TunnelRotors>(m, "MotorTunnelRotors");
}

}  // namespace hil::sim
