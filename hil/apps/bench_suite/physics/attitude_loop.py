"""Minimal flight controller for the stability sweeps: a PD attitude loop at the tick rate and a PD position loop.

It is not a model of an autopilot: every method is flown with the same loop, whose one gain is adjustable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle

_FREQUENCY_RADPS, _DAMPING = 8.0, 0.8  # of the attitude loop at gain 1
_POSITION_GAIN_PER_S2, _SPEED_GAIN_PER_S = 1.0, 1.8  # commanded acceleration per position error and per speed error
_MAX_TILT_RAD = 0.3


@dataclass(frozen=True)
class Circle:
    """A level circle to follow, counter-clockwise from its easternmost point."""

    center_m: tuple[float, float, float]
    radius_m: float
    round_ticks: int

    def points(self) -> list[tuple[float, float, float]]:
        """Return the position in W [m] at each tick of a round."""
        x, y, z = self.center_m
        angles = [2.0 * math.pi * tick / self.round_ticks for tick in range(self.round_ticks)]
        return [(x + self.radius_m * math.cos(a), y + self.radius_m * math.sin(a), z) for a in angles]


class AttitudeLoop:
    """Controller of a quadrotor with rotors in X order. Without a circle it only levels the vehicle."""

    def __init__(self, vehicle: Vehicle, *, gain: float, circle: Circle | None = None) -> None:
        self.hover = multirotor.hover_control(vehicle)
        self._points = circle.points() if circle is not None else []
        self._tick = 0
        c = vehicle.rotor_constants
        speed = multirotor.speed_radps(vehicle, self.hover)
        # dT/du at hover, for a thrust that is quadratic in the command [N].
        slope = 2.0 * c.thrust_coefficient_n_per_radps2 * speed * speed / self.hover
        x, y = abs(vehicle.rotors[0].position_m[0]), abs(vehicle.rotors[0].position_m[1])
        ix, iy, iz = vehicle.inertia_kgm2
        torques = (
            4.0 * y * slope,
            4.0 * x * slope,
            4.0 * c.moment_ratio_m * slope,
        )  # roll, pitch, yaw: per unit of command [N m]
        stiff = gain * _FREQUENCY_RADPS * _FREQUENCY_RADPS
        damp = gain * 2.0 * _DAMPING * _FREQUENCY_RADPS
        self._kp = (stiff * ix / torques[0], stiff * iy / torques[1], 0.1 * stiff * iz / torques[2])
        self._kd = (damp * ix / torques[0], damp * iy / torques[1], 0.3 * damp * iz / torques[2])
        self._command_per_mps2 = vehicle.mass_kg / (4.0 * slope)

    def commands(self, s: Sequence[float]) -> tuple[float, float, float, float]:
        """Return the four commands for the state (p, q, v, w) in W and B. Call once per tick."""
        roll_wanted = pitch_wanted = lift_mps2 = 0.0
        w, x, y, z = s[3:7]
        if w < 0.0:
            w, x, y, z = -w, -x, -y, -z
        if self._points:
            east, north, up = self._points[self._tick % len(self._points)]
            self._tick += 1
            ax = -_POSITION_GAIN_PER_S2 * (s[0] - east) - _SPEED_GAIN_PER_S * s[7]
            ay = -_POSITION_GAIN_PER_S2 * (s[1] - north) - _SPEED_GAIN_PER_S * s[8]
            lift_mps2 = -_POSITION_GAIN_PER_S2 * (s[2] - up) - _SPEED_GAIN_PER_S * s[9]
            # The heading stays near east, so x is forward and y is left.
            pitch_wanted, roll_wanted = _limited(ax / STANDARD_GRAVITY_MPS2), _limited(-ay / STANDARD_GRAVITY_MPS2)
        roll = self._kp[0] * (roll_wanted - 2.0 * w * x) - self._kd[0] * s[10]
        pitch = self._kp[1] * (pitch_wanted - 2.0 * w * y) - self._kd[1] * s[11]
        yaw = -self._kp[2] * 2.0 * w * z - self._kd[2] * s[12]
        base = self.hover + self._command_per_mps2 * lift_mps2
        return (
            base - roll - pitch - yaw,
            base + roll + pitch - yaw,
            base + roll - pitch + yaw,
            base - roll + pitch + yaw,
        )


def _limited(tilt_rad: float) -> float:
    return max(-_MAX_TILT_RAD, min(_MAX_TILT_RAD, tilt_rad))
