"""Camera that follows a vehicle from behind and above.

    heading    of the way over the ground where the vehicle is faster than 1.5 m/s, else of its nose; turned after it
               with a time constant of 0.8 s
    aim        the vehicle's position, with a time constant of 0.12 s
    place      `distance_m` behind the aim and 0.35 of that above it; nearer where something stands between them, and
               never below 0.3 m above z = 0 of the start

The pose is a function of the states that it was given, in their order. World W is ENU; the optical frame C looks along
z with x to the right and y down.
"""

from __future__ import annotations

from math import atan2, cos, exp, hypot, pi, sin, sqrt
from typing import Protocol

from signals.rotation import cross
from signals.samples import TruthState, Vec3
from sim.frame.camera_pose import CameraPose

_TURN_S, _AIM_S = 0.8, 0.12
_MOVING_MPS = 1.5
_RISE = 0.35
_GAP_M = 0.25  # between the camera and what stands behind the vehicle
_OVER_GROUND_M = 0.3
_LENGTHS = 4.0  # distance over the vehicle's size
_LEAST_M = 1.2


class Solids(Protocol):
    """Static scene."""

    def distance(self, p_W: Vec3) -> float:
        """Return a lower bound of the distance to the nearest shape [m]."""
        ...


class ChaseCamera:
    """Pose of the camera behind one vehicle."""

    def __init__(self, radius_m: float, solids: Solids | None) -> None:
        """`radius_m`: of the vehicle. `solids`: what the camera must not be hidden by."""
        self._distance_m = max(_LEAST_M, 2.0 * _LENGTHS * radius_m)
        self._radius_m = radius_m
        self._solids = solids
        self._t_ns: int | None = None
        self._aim_W: Vec3 = (0.0, 0.0, 0.0)
        self._heading_rad = 0.0
        self._floor_z = 0.0

    def restart(self) -> None:
        """Begin anew behind the next state."""
        self._t_ns = None

    def follow(self, truth: TruthState) -> CameraPose:
        """Return the pose for the next picture."""
        p, v = truth.p_WB, truth.v_WB_W
        wanted = _course(truth)
        if self._t_ns is None or truth.t_ns < self._t_ns:
            self._aim_W, self._heading_rad = p, wanted
            self._floor_z = min(0.0, p[2])
        else:
            dt_s = 1e-9 * (truth.t_ns - self._t_ns)
            turn, near = 1.0 - exp(-dt_s / _TURN_S), exp(-dt_s / _AIM_S)
            self._heading_rad += turn * ((wanted - self._heading_rad + pi) % (2.0 * pi) - pi)
            x, y, z = self._aim_W
            self._aim_W = (p[0] + near * (x - p[0]), p[1] + near * (y - p[1]), p[2] + near * (z - p[2]))
        self._t_ns = truth.t_ns
        size = sqrt(1.0 + _RISE * _RISE)
        back = (-cos(self._heading_rad) / size, -sin(self._heading_rad) / size, _RISE / size)
        reach_m = self._reach_m(back)
        x, y, z = self._aim_W
        eye = (x + reach_m * back[0], y + reach_m * back[1], z + reach_m * back[2])
        eye = (eye[0], eye[1], max(eye[2], self._floor_z + _OVER_GROUND_M))
        return looking(eye, self._aim_W, v)

    def _reach_m(self, back: Vec3) -> float:
        """Return how far the camera may be from the aim without being behind something."""
        most_m = self._distance_m
        if self._solids is None:
            return most_m
        x, y, z = self._aim_W
        reach_m = least_m = 2.0 * self._radius_m
        while reach_m < most_m:
            free_m = self._solids.distance((x + reach_m * back[0], y + reach_m * back[1], z + reach_m * back[2]))
            if free_m < _GAP_M:
                break
            reach_m += free_m
        return max(least_m, min(reach_m, most_m))


def looking(eye_W: Vec3, target_W: Vec3, v_W: Vec3 = (0.0, 0.0, 0.0)) -> CameraPose:
    """Return the pose of a camera at a place that looks at another one, with the horizon level."""
    dx, dy, dz = (b - a for a, b in zip(eye_W, target_W, strict=True))
    far = sqrt(dx * dx + dy * dy + dz * dz) or 1.0
    ahead = (dx / far, dy / far, dz / far)
    level = hypot(ahead[0], ahead[1])
    right = (ahead[1] / level, -ahead[0] / level, 0.0) if level > 1e-6 else (0.0, -1.0, 0.0)
    down = cross(ahead, right)
    rows = tuple(axis[i] for i in range(3) for axis in (right, down, ahead))
    return CameraPose(eye_W, rows, v_W)  # type: ignore[arg-type]


def _course(truth: TruthState) -> float:
    """Return the direction in which the vehicle flies, or its nose points, from east to north [rad]."""
    vx, vy, _ = truth.v_WB_W
    if hypot(vx, vy) > _MOVING_MPS:
        return atan2(vy, vx)
    w, x, y, z = truth.q_WB
    return atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
