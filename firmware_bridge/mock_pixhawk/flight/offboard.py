"""OFFBOARD: set-points that a companion computer streams.

The latest SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT or SET_ATTITUDE_TARGET is stored and flown
while the mode is on. As in PX4, the mode can be entered only while set-points arrive at more than 2 Hz; COM_OF_LOSS_T
after the last one the failsafe acts.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan, sqrt
from typing import Any

from firmware_bridge._native import FlightCore
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.guidance import ATTITUDE, POSITION, RATE
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals._kernel import roll_pitch_yaw

_FRAME_LOCAL_NED, _FRAME_BODY_NED = 1, 8
_GLOBAL, _GLOBAL_RELATIVE = (0, 5), (3, 6)
_MAX_GAP_US = 500_000  # 2 Hz

# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK
_IGNORE_POSITION = (0x1, 0x2, 0x4)
_IGNORE_VELOCITY = (0x8, 0x10, 0x20)
_IGNORE_YAW, _IGNORE_YAW_RATE = 0x400, 0x800
_IGNORE_ATTITUDE = 0x80


class Offboard:
    """The latest set-point and its time of arrival. Lengths in m NED."""

    def __init__(self, core: FlightCore, vehicle: Vehicle, project: Callable[[float, float, float], Point]) -> None:
        self._core, self._vehicle, self._project = core, vehicle, project
        self._setpoint: tuple[int, tuple[float, ...]] | None = None
        self._yaw = 0.0
        self.last_us: int | None = None

    def fresh(self, now_us: int, limit_us: int = _MAX_GAP_US) -> bool:
        """Return True if a set-point arrived within the last `limit_us`."""
        return self.last_us is not None and now_us - self.last_us <= limit_us

    def _keep(self, now_us: int, kind: int, values: tuple[float, ...]) -> None:
        if not any(value in (float("inf"), float("-inf")) for value in values):
            self._setpoint = (kind, values)
            self.last_us = now_us

    def on_local(self, m: Any, now_us: int) -> None:
        """Handle SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED, or BODY_NED for velocities."""
        if m.coordinate_frame == _FRAME_LOCAL_NED:
            position, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
        elif m.coordinate_frame == _FRAME_BODY_NED:
            c, s = el.cos(self._vehicle.yaw), el.sin(self._vehicle.yaw)
            position, velocity = (nan, nan, nan), (m.vx * c - m.vy * s, m.vx * s + m.vy * c, m.vz)
        else:
            return
        self._position_target(m, position, velocity, now_us)

    def on_global(self, m: Any, now_us: int) -> None:
        """Handle SET_POSITION_TARGET_GLOBAL_INT; altitude above sea level or home."""
        home = self._vehicle.home
        alt = m.alt
        if m.coordinate_frame in _GLOBAL_RELATIVE and home is not None:
            alt += home.alt_m
        elif m.coordinate_frame not in _GLOBAL:
            return
        if not (abs(m.lat_int) <= 900_000_000 and abs(m.lon_int) <= 1_800_000_000):
            return
        self._position_target(m, self._project(m.lat_int / 1e7, m.lon_int / 1e7, alt), (m.vx, m.vy, m.vz), now_us)

    def _position_target(self, m: Any, position: Point, velocity: Point, now_us: int) -> None:
        mask = m.type_mask
        p = tuple(nan if mask & bit else x for x, bit in zip(position, _IGNORE_POSITION, strict=True))
        v = tuple(nan if mask & bit else x for x, bit in zip(velocity, _IGNORE_VELOCITY, strict=True))
        if any(a != a and b != b for a, b in zip(p, v, strict=True)):
            return  # an axis without position and velocity cannot be flown
        # Without velocity the position is a target at rest.
        v = tuple(0.0 if x != x else x for x in v)
        yaw = nan if mask & _IGNORE_YAW else m.yaw
        rate = 0.0 if mask & _IGNORE_YAW_RATE or m.yaw_rate != m.yaw_rate else m.yaw_rate
        self._keep(now_us, POSITION, (*p, *v, yaw, rate))

    def on_attitude(self, m: Any, now_us: int) -> None:
        """Handle SET_ATTITUDE_TARGET: attitude with thrust, or body rates with thrust."""
        thrust = min(max(m.thrust, 0.0), 1.0) if m.thrust == m.thrust else 0.0
        if m.type_mask & _IGNORE_ATTITUDE:
            rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
            if all(rate == rate for rate in rates):
                self._keep(now_us, RATE, (*rates, thrust, 0.0, 0.0, 0.0, 0.0))
            return
        w, x, y, z = m.q
        square = w * w + x * x + y * y + z * z
        if not 0.5 < square < 2.0:
            return
        k = 1.0 / sqrt(square)
        roll, pitch, yaw = roll_pitch_yaw((w * k, x * k, y * k, z * k))
        self._keep(now_us, ATTITUDE, (roll, pitch, thrust, 0.0, 0.0, 0.0, yaw, 0.0))

    # -- as a flight mode ---------------------------------------------------------------------------------------

    def start(self, now_us: int) -> None:  # noqa: ARG002
        self._yaw = self._vehicle.yaw

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        if self._setpoint is None:
            return None
        kind, (x, y, z, vx, vy, vz, yaw, rate) = self._setpoint
        if kind == POSITION:
            if yaw == yaw:
                self._yaw = el.wrap_pi(yaw) if abs(yaw) < 100.0 else self._yaw
            else:
                self._yaw = el.wrap_pi(self._yaw + rate * 0.02)
            yaw = self._yaw
        self._core.set_setpoint(kind, x, y, z, vx, vy, vz, yaw, rate)
        return None
