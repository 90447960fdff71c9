"""Manual modes with MANUAL_CONTROL: attitude, altitude, position.

Same interface as in `flight_modes`.
"""

from __future__ import annotations

from math import nan, sqrt

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.guidance import PERIOD_US, Guidance
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import ManualControl, Vehicle
from signals.units import RAD_PER_DEG

_DEAD_ZONE = 0.1  # MPC_HOLD_DZ
_YAW_RATE_SHARE = 0.5  # full yaw stick in position mode, as a share of MPC_MAN_Y_MAX
_LOCK_SPEED_MPS = 0.8  # MPC_HOLD_MAX_XY
# Altitude mode on the ground: if the stick is below _LAND_STICK and the vehicle sinks at less than _LAND_SPEED_SHARE of
# the commanded speed for _LAND_AFTER_US, thrust falls to _LAND_THRUST_SHARE of hover, and the land detector triggers.
_LAND_STICK = -0.5
_LAND_SPEED_SHARE = 0.2
_LAND_AFTER_US = 300_000
_LAND_THRUST_SHARE = 0.2
_CENTRE = ManualControl(0, 0.0, 0.0, 0.5, 0.0)


def _with_dead_zone(stick: float) -> float:
    """Apply a dead zone around the centre of a stick: continuous, and still reaching +-1."""
    if abs(stick) <= _DEAD_ZONE:
        return 0.0
    return (stick - _DEAD_ZONE if stick > 0.0 else stick + _DEAD_ZONE) / (1.0 - _DEAD_ZONE)


class ManualAttitude:
    """MANUAL and STABILIZED (sticks are roll, pitch, yaw rate and thrust) and ALTCTL (climb rate for thrust)."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable, *, holds_altitude: bool) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._holds_altitude = holds_altitude
        self._sinking_us = 0  # time when the vehicle last sank as commanded, or no descent was commanded

    def start(self, now_us: int) -> None:
        self._sinking_us = now_us

    def step(self, now_us: int) -> Mode | None:
        sticks = self._vehicle.manual or _CENTRE
        p, guidance = self._params, self._guidance
        if self._vehicle.landed:
            self._sinking_us = now_us
        if self._vehicle.landed and sticks.throttle < (0.55 if self._holds_altitude else 0.1):
            guidance.idle()
            return None
        tilt = p["MPC_MAN_TILT_MAX"] * RAD_PER_DEG
        yaw_rate = _with_dead_zone(sticks.yaw) * p["MPC_MAN_Y_MAX"] * RAD_PER_DEG
        if self._holds_altitude:
            climb = _with_dead_zone(2.0 * sticks.throttle - 1.0)
            limit = p["MPC_Z_VEL_MAX_UP"] if climb > 0.0 else p["MPC_Z_VEL_MAX_DN"]
            thrust = guidance.climb_thrust(-climb * limit)
            if climb > _LAND_STICK or self._vehicle.v_d > -climb * limit * _LAND_SPEED_SHARE:
                self._sinking_us = now_us
            elif now_us - self._sinking_us >= _LAND_AFTER_US:
                thrust = p["MPC_THR_HOVER"] * _LAND_THRUST_SHARE
        else:
            # PX4's throttle curve: hover thrust at the middle, straight lines to both ends.
            hover, least, t = p["MPC_THR_HOVER"], p["MPC_THR_MIN"], sticks.throttle
            thrust = least + (hover - least) * 2.0 * t if t < 0.5 else hover + (1.0 - hover) * (2.0 * t - 1.0)
        guidance.attitude(sticks.roll * tilt, -sticks.pitch * tilt, thrust, yaw_rate)
        return None


class ManualPosition:
    """POSCTL: sticks are velocities in the direction of heading; with sticks centred the position is held."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._vn = self._ve = self._vd = 0.0
        self._n = self._e = self._d = nan

    def start(self, now_us: int) -> None:  # noqa: ARG002
        v = self._vehicle
        self._vn, self._ve, self._vd = v.v_n, v.v_e, v.v_d
        self._n = self._e = self._d = nan

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        v, p, guidance = self._vehicle, self._params, self._guidance
        sticks = v.manual or _CENTRE
        climb = _with_dead_zone(2.0 * sticks.throttle - 1.0)
        if v.landed and climb <= 0.0:
            guidance.idle()
            self.start(0)
            return None
        speed = min(p["MPC_VEL_MANUAL"], p["MPC_XY_VEL_MAX"])
        forward, right = _with_dead_zone(sticks.pitch) * speed, _with_dead_zone(sticks.roll) * speed
        c, s = el.cos(guidance.yaw), el.sin(guidance.yaw)
        want_n, want_e = forward * c - right * s, forward * s + right * c
        want_d = -climb * (p["MPC_Z_VEL_MAX_UP"] if climb > 0.0 else p["MPC_Z_VEL_MAX_DN"])
        step = p["MPC_ACC_HOR"] * PERIOD_US * 1e-6
        self._vn += min(max(want_n - self._vn, -step), step)
        self._ve += min(max(want_e - self._ve, -step), step)
        self._vd += min(max(want_d - self._vd, -step), step)
        if want_n != 0.0 or want_e != 0.0:
            self._n = self._e = nan
        elif self._n != self._n and sqrt(v.v_n * v.v_n + v.v_e * v.v_e) < _LOCK_SPEED_MPS:
            self._n, self._e = v.pos_n, v.pos_e
        if want_d != 0.0:
            self._d = nan
        elif self._d != self._d and abs(v.v_d) < 0.3:
            self._d = v.pos_d
        yaw_rate = _with_dead_zone(sticks.yaw) * p["MPC_MAN_Y_MAX"] * _YAW_RATE_SHARE * RAD_PER_DEG
        guidance.velocity(self._n, self._e, self._d, self._vn, self._ve, self._vd, yaw_rate)
        return None
