"""Remote control: AirSim's moveByRC and moveByManual.

Without API control the sticks command the vehicle, as simple_flight does: roll and pitch up to 180 / 5.5 degrees, yaw
rate up to 180 degrees/s, throttle 0..1; with switch 1 they are rates. Without a valid remote control the rotors stop.

Differences from AirSim: `moveByManual` flies a stick along the heading at its start (AirSim turns it the wrong way
round unless that is north). The scale is AirSim's: full deflection is 10000, so a stick of 1 gives vx_max / 10000.
"""

from __future__ import annotations

from typing import NamedTuple

from hil.apps.airsim.flight.move import NOTHING, Clock, Command, NedState, Xy, finite, limit_of
from hil.apps.airsim.flight.yaw import YawMode, check_heading, heading_of
from signals._kernel import det_cos, det_sin
from signals.time import NS_PER_MS

_FULL_TILT_RAD = 3.14159265359 / 5.5
_FULL_YAW_RADPS = 3.14159265359
_LEAST_THROTTLE = 0.1 / 1.5
_MANUAL_FULL_SCALE = 10000.0
_MANUAL_YAW_DEG = 100.0
_OLDEST_NS = 100 * NS_PER_MS


class RcData(NamedTuple):
    """Sticks, -1..1 (throttle 0..1), and switches of a remote control."""

    timestamp_ns: int = 0  # 0: always fresh
    pitch: float = 0.0  # positive: forward
    roll: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0
    rates: bool = False  # switch 1
    is_valid: bool = False

    def checked(self) -> RcData:
        """Return these data. Raises MoveError for a stick that is not finite."""
        finite(pitch=self.pitch, roll=self.roll, throttle=self.throttle, yaw=self.yaw)
        return self

    def command(self) -> Command:
        """Return the command of the sticks."""
        if not self.is_valid:
            return Command(pwms=(0.0, 0.0, 0.0, 0.0))
        sticks = (self.roll * _FULL_TILT_RAD, -self.pitch * _FULL_TILT_RAD)
        yaw_rate, throttle = self.yaw * _FULL_YAW_RADPS, max(self.throttle, _LEAST_THROTTLE)
        if self.rates:
            return Command(roll_pitch_rate_radps=sticks, yaw_rate_radps=yaw_rate, throttle=throttle)
        return Command(roll_pitch_rad=sticks, yaw_rate_radps=yaw_rate, throttle=throttle)


class Receiver:
    """Last data of the remote control of one vehicle."""

    def __init__(self) -> None:
        self.data = RcData()


class Manual:
    """Flight by the sticks of the remote control, within limits of speed and height."""

    def __init__(
        self, receiver: Receiver, speed_max_mps: Xy, z_min_m: float, duration_s: float, drivetrain: int,
        yaw_mode: YawMode,
    ) -> None:  # fmt: skip
        finite(vx_max=speed_max_mps[0], vy_max=speed_max_mps[1], z_min=z_min_m)
        check_heading(yaw_mode, drivetrain)
        duration_s = limit_of(duration=duration_s)
        self.succeeded = self._empty = duration_s <= 0.0
        self._clock = Clock(duration_s)
        self._receiver = receiver
        self._speed_max_mps, self._z_min_m = speed_max_mps, z_min_m
        self._drivetrain, self._yaw_mode = drivetrain, yaw_mode
        self._ahead: Xy | None = None

    def step(self, state: NedState) -> Command | None:
        """Return the command of fresh sticks, nothing for old ones; None after the duration."""
        if self._empty:
            return None
        if self._ahead is None:
            self._ahead = (det_cos(state.yaw_rad), det_sin(state.yaw_rad))
        if self._clock.over(state.t_ns):
            self.succeeded = True
            return None
        rc = self._receiver.data
        if not rc.is_valid or (rc.timestamp_ns and state.t_ns - rc.timestamp_ns > _OLDEST_NS):
            return NOTHING
        c, s = self._ahead
        forward = rc.pitch * self._speed_max_mps[1] / _MANUAL_FULL_SCALE
        right = rc.roll * self._speed_max_mps[0] / _MANUAL_FULL_SCALE
        course = (forward * c - right * s, forward * s + right * c)
        mode = self._yaw_mode._replace(
            yaw_or_rate=self._yaw_mode.yaw_or_rate + rc.yaw * _MANUAL_YAW_DEG / _MANUAL_FULL_SCALE
        )
        z_m = state.p_m[2] + rc.throttle / _MANUAL_FULL_SCALE * self._z_min_m
        return Command(v_xy_mps=course, z_m=z_m, **heading_of(mode, self._drivetrain, course)._asdict())
