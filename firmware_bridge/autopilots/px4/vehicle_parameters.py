"""The parameters that make an airframe of PX4 the vehicle of a bench, multirotor, plane or VTOL."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import Aircraft, FixedWing, Vtol
from firmware_bridge.autopilots.px4 import wing_parameters
from firmware_bridge.autopilots.px4.rotor_parameters import motor_functions, px4_parameters
from firmware_bridge.autopilots.px4.vtol_parameters import px4_vtol_parameters, vtol_functions

PWM_OUTPUTS, HIL_OUTPUTS = "PWM_MAIN_FUNC", "HIL_ACT_FUNC"  # of SITL and of a board


def vehicle_parameters(vehicle: Aircraft, outputs: str = PWM_OUTPUTS) -> dict[str, float]:
    """Return the parameters of a vehicle, the functions of the outputs among them."""
    if isinstance(vehicle, Vtol):
        return vehicle_functions(vehicle, outputs) | px4_vtol_parameters(vehicle)
    if isinstance(vehicle, FixedWing):
        return (
            wing_parameters.output_functions(vehicle, outputs)
            | wing_parameters.plane_parameters(vehicle)
            | wing_parameters.px4_parameters(vehicle)
        )
    return px4_parameters(vehicle, outputs=outputs)


def vehicle_functions(vehicle: Aircraft, outputs: str) -> dict[str, float]:
    """Return the functions of the outputs alone."""
    if isinstance(vehicle, Vtol):
        return vtol_functions(vehicle, outputs)
    if isinstance(vehicle, FixedWing):
        return wing_parameters.output_functions(vehicle, outputs)
    return motor_functions(vehicle, outputs)


def command_count(vehicle: Aircraft) -> int:
    """Return the number of commands: of motors, tilts, surfaces."""
    if isinstance(vehicle, Vtol):
        return len(vehicle.lifters) + len(vehicle.pushers) + len(vehicle.tilts) + len(vehicle.wing.surfaces)
    return len(vehicle.rotors) + (len(vehicle.surfaces) if isinstance(vehicle, FixedWing) else 0)
