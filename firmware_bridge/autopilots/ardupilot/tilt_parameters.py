"""ArduPlane's parameters for the hinges of a tiltrotor.

A hinge on each side of the vehicle is ArduPlane's "vectored yaw" (Q_TILT_TYPE 2): in hover, and on the way to the
wings, the tilts steer the yaw against each other. Without it ("continuous", type 0) ArduPlane lets the yaw go in the
front transition (SLT_Transition::update), and wind turns the vehicle away before a plane could steer.

Its tilts have the range of -Q_TILT_YAW_ANGLE to 90 degrees (Tiltrotor::vectoring), linear from SERVOn_MIN to _MAX, and
0 is hover. A hinge that goes back behind the upright by the yaw angle, y, has just this. One that ends at the angle a
before that is told as if it did: its rotors then lean ahead in hover, by

    h = a + (A - a) y / (90 + y),    A: the angle in flight

which the body's pitch makes up for. As h leans ahead, a yaw angle of 8 degrees is enough for the yaw: two tilted rotors
with half the weight m g, l from the middle, give the torque m g l sin(h - a) / 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, pi, sin

from firmware_bridge.autopilots.installation import Tilt, Vtol
from signals.units import STANDARD_GRAVITY_MPS2

_ALL, _LEFT, _RIGHT = 41, 75, 76  # SERVOn_FUNCTION
_CONTINUOUS, _VECTORED = 0, 2  # Q_TILT_TYPE
_YAW_ANGLE_RAD = 8.0 * pi / 180.0
_QUARTER_RAD = 0.5 * pi


def tilt_parameters(vehicle: Vtol, motors: Sequence[int], first_output: int) -> dict[str, float]:
    """Return Q_TILT_* and SERVOn_* of the hinges, of which the first is at `first_output`; nothing without hinges.

    `motors`: the vehicle's rotor that each of ArduPilot's motors is.
    """
    if not vehicle.tilts:
        return {}
    tilting = {rotor for tilt in vehicle.tilts for rotor in tilt.rotors}
    mask = sum(1 << motor for motor, rotor in enumerate(motors) if rotor in tilting)
    sides = sides_of(vehicle)
    values: dict[str, float] = {"Q_TILT_ENABLE": 1, "Q_TILT_MASK": mask}
    values["Q_TILT_TYPE"] = _CONTINUOUS if sides is None else _VECTORED
    if sides is not None:
        values["Q_TILT_YAW_ANGLE"] = degrees(_YAW_ANGLE_RAD)
    for i, tilt in enumerate(vehicle.tilts):
        function = _ALL if sides is None else _LEFT if sides[i] > 0.0 else _RIGHT
        values |= tilt_output(first_output + i, tilt, function)
    return values


def sides_of(vehicle: Vtol) -> list[float] | None:
    """Return the distance of each hinge's rotors from the middle [m], to the left above 0.

    None unless there are two hinges of lifters, one on each side.
    """
    if len(vehicle.tilts) != 2 or not {rotor for tilt in vehicle.tilts for rotor in tilt.rotors} <= set(
        vehicle.lifters
    ):
        return None
    place = dict(zip(vehicle.lifters, (rotor.position_m for rotor in vehicle.hover.rotors), strict=True))
    sides = [sum(place[rotor][1] for rotor in tilt.rotors) / len(tilt.rotors) for tilt in vehicle.tilts]
    return sides if sides[0] * sides[1] < 0.0 else None


def tilt_output(n: int, tilt: Tilt, function: int) -> dict[str, float]:
    """Return SERVOn_* of a hinge: from hover, or the yaw angle behind it, to flight."""
    back = tilt.hover_command if function == _ALL else tilt.hover_command + _back(tilt) * _slope(tilt)
    ends_us = sorted(round(1500.0 + 500.0 * command) for command in (back, tilt.ahead_command))
    return {
        f"SERVO{n}_FUNCTION": function,
        f"SERVO{n}_REVERSED": int(tilt.ahead_command < tilt.hover_command),
        f"SERVO{n}_MIN": ends_us[0],
        f"SERVO{n}_MAX": ends_us[1],
        f"SERVO{n}_TRIM": ends_us[0],
    }


def yaw_torque_nm(vehicle: Vtol) -> float | None:
    """Return the torque about the vertical of a full demand of yaw in hover; None without vectored yaw."""
    sides = sides_of(vehicle) if vehicle.tilts else None
    if sides is None:
        return None
    share = sum(len(tilt.rotors) for tilt in vehicle.tilts) / len(vehicle.lifters)
    lean = min(_lean_rad(tilt) for tilt in vehicle.tilts)
    arm = 0.5 * sum(abs(side) for side in sides)
    return share * vehicle.hover.mass_kg * STANDARD_GRAVITY_MPS2 * arm * sin(lean)


def _slope(tilt: Tilt) -> float:
    """Return the command per angle ahead [1/rad], below 0 where a greater command leans back."""
    return (tilt.ahead_command - tilt.hover_command) / abs(tilt.ahead_rad)


def _back(tilt: Tilt) -> float:
    """Return the angle at the hinge's end behind hover, at most the yaw angle [rad, 0 or below]."""
    behind = tilt.min_rad if tilt.ahead_rad > 0.0 else -tilt.max_rad
    return min(max(behind, -_YAW_ANGLE_RAD), 0.0)


def _lean_rad(tilt: Tilt) -> float:
    """Return the angle between the hinge's end behind and ArduPlane's hover."""
    return (abs(tilt.ahead_rad) - _back(tilt)) * _YAW_ANGLE_RAD / (_QUARTER_RAD + _YAW_ANGLE_RAD)
