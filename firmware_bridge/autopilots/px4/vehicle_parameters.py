"""The parameters that make an airframe of PX4 the vehicle of a bench, multirotor or plane."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import FixedWing, Multirotor
from firmware_bridge.autopilots.px4 import wing_parameters
from firmware_bridge.autopilots.px4.rotor_parameters import motor_functions, px4_parameters

PWM_OUTPUTS, HIL_OUTPUTS = "PWM_MAIN_FUNC", "HIL_ACT_FUNC"  # of SITL and of a board


def vehicle_parameters(vehicle: Multirotor | FixedWing, outputs: str = PWM_OUTPUTS) -> dict[str, float]:
    """Return the parameters of a vehicle, the functions of the outputs among them."""
    if isinstance(vehicle, FixedWing):
        return (
            wing_parameters.output_functions(vehicle, outputs)
            | wing_parameters.plane_parameters(vehicle)
            | wing_parameters.px4_parameters(vehicle)
        )
    return px4_parameters(vehicle, outputs=outputs)


def vehicle_functions(vehicle: Multirotor | FixedWing, outputs: str) -> dict[str, float]:
    """Return the functions of the outputs alone."""
    if isinstance(vehicle, FixedWing):
        return wing_parameters.output_functions(vehicle, outputs)
    return motor_functions(vehicle, outputs)


def command_count(vehicle: Multirotor | FixedWing) -> int:
    """Return the number of commands: of motors, then of surfaces."""
    return len(vehicle.rotors) + (len(vehicle.surfaces) if isinstance(vehicle, FixedWing) else 0)
