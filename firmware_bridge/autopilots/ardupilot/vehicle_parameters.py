"""The parameters that make ArduPilot's aircraft the vehicle of a bench, and the program that flies it."""

from __future__ import annotations

from pathlib import Path

from firmware_bridge.autopilots.ardupilot.copter import frame_parameters
from firmware_bridge.autopilots.ardupilot.vtol_parameters import vtol_parameters
from firmware_bridge.autopilots.ardupilot.wing_parameters import plane_parameters
from firmware_bridge.autopilots.installation import Aircraft, FixedWing, Multirotor, Vtol
from firmware_bridge.links.ardupilot.sitl import DEFAULTS_PATH, PLANE_DEFAULTS_PATH, thrust_parameters


def vehicle_parameters(vehicle: Aircraft) -> dict[str, float]:
    """Return the parameters of ArduCopter or ArduPlane for a vehicle. LinkError if it has no frame for its rotors."""
    if isinstance(vehicle, Vtol):
        return vtol_parameters(vehicle)
    if isinstance(vehicle, FixedWing):
        return plane_parameters(vehicle)
    return thrust_parameters(vehicle.hover_control, vehicle.thrust_model_factor) | frame_parameters(vehicle)


def base_file(vehicle: Aircraft) -> Path:
    """Return the file with the parameters of every vehicle that the same program flies."""
    return DEFAULTS_PATH if isinstance(vehicle, Multirotor) else PLANE_DEFAULTS_PATH


def build_name(vehicle: Aircraft) -> str:
    """Return the name of the program that flies the vehicle, as ArduPilot's build makes it."""
    return "arducopter" if isinstance(vehicle, Multirotor) else "arduplane"
