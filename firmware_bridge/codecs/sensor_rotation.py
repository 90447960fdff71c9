"""Direction of a ranging sensor as MAVLink and ArduPilot's RNGFNDn_ORIENT say it: one of ten, or a quaternion.

B (FLU) -> F (FRD) changes the sign of y and z.
"""

from __future__ import annotations

import math

from signals.samples import Quat, Vec3

CUSTOM = 100  # MAV_SENSOR_ROTATION_CUSTOM
_UP, _DOWN = 24, 25  # MAV_SENSOR_ROTATION_PITCH_90, MAV_SENSOR_ROTATION_PITCH_270
_SAME = 1e-6  # rounding of a direction, as a difference of unit vectors
_DIAGONAL = math.sqrt(0.5)

# By number of the MAV_SENSOR_ROTATION: the axis in F. 0 to 7 are steps of 45 degrees to the right.
_AXES_F: dict[int, Vec3] = {
    0: (1.0, 0.0, 0.0),
    1: (_DIAGONAL, _DIAGONAL, 0.0),
    2: (0.0, 1.0, 0.0),
    3: (-_DIAGONAL, _DIAGONAL, 0.0),
    4: (-1.0, 0.0, 0.0),
    5: (-_DIAGONAL, -_DIAGONAL, 0.0),
    6: (0.0, -1.0, 0.0),
    7: (_DIAGONAL, -_DIAGONAL, 0.0),
    _UP: (0.0, 0.0, -1.0),
    _DOWN: (0.0, 0.0, 1.0),
}


def named_rotation(axis_B: Vec3) -> int | None:
    """Return the MAV_SENSOR_ROTATION of a direction: level in steps of 45 degrees, up or down. None for any other."""
    axis_F = (axis_B[0], -axis_B[1], -axis_B[2])
    return next((number for number, named in _AXES_F.items() if math.dist(axis_F, named) < _SAME), None)


def rotation_to(axis_B: Vec3) -> Quat:
    """Return the shortest rotation from forward to a direction other than backward, w-x-y-z in F."""
    x, y, z = axis_B[0], -axis_B[1], -axis_B[2]
    scale = math.sqrt(2.0 * (1.0 + x))
    return ((1.0 + x) / scale, 0.0, -z / scale, y / scale)
