"""Moves at one place: AirSim's hover, rotateToYaw and land.

Differences from AirSim: `hover` returns True after one period (there False at once), and keeps the place where it was
called. `rotateToYaw` measures the margin the short way round, and turns on to the angle itself while the margin is
reached and the vehicle stops. `land` ends on the ground with idle rotors (there after 11 periods without descent), and
the vehicle counts as landed from then on.
"""

from __future__ import annotations

from hil.apps.airsim.flight.move import NOTHING, Clock, Command, NedState, finite, limit_of
from hil.apps.airsim.flight.yaw import normalized_deg
from signals.units import DEG_PER_RAD, RAD_PER_DEG

LANDING_SPEED_MPS = 0.2
_STILL_RADPS = 0.01


def stay(state: NedState, *, yaw_rad: float | None = None) -> Command:
    """Return the command to hold the place of a state and its heading, or another one."""
    x, y, z = state.p_m
    return Command(p_xy_m=(x, y), z_m=z, yaw_rad=yaw_rad, yaw_rate_radps=0.0 if yaw_rad is None else None)


class Hover:
    """Stay at the place where the move began."""

    def __init__(self) -> None:
        self.succeeded = False

    def step(self, state: NedState) -> Command | None:
        """Return the place once; None afterwards: the vehicle goes on holding it."""
        if self.succeeded:
            return None
        self.succeeded = True
        return stay(state)


class RotateToYaw:
    """Turn to a heading over the place where the move began."""

    def __init__(self, yaw_deg: float, timeout_s: float, margin_deg: float) -> None:
        finite(yaw=yaw_deg, margin=margin_deg)
        timeout_s = limit_of(timeout_sec=timeout_s)
        self.succeeded = timeout_s <= 0.0
        self._clock = Clock(timeout_s)
        self._yaw_deg, self._margin_deg = normalized_deg(yaw_deg), margin_deg
        self._command = NOTHING

    def step(self, state: NedState) -> Command | None:
        """Return the heading; None once the vehicle has it and turns no more, or the time is over."""
        if self.succeeded:
            return None
        if self._command is NOTHING:
            self._command = stay(state, yaw_rad=self._yaw_deg * RAD_PER_DEG)
        error_deg = normalized_deg(state.yaw_rad * DEG_PER_RAD - self._yaw_deg)
        if abs(error_deg) <= self._margin_deg and abs(state.w_radps[2]) <= _STILL_RADPS:
            self.succeeded = True
            return None
        return None if self._clock.over(state.t_ns) else self._command


class Land:
    """Descend at 0.2 m/s until the vehicle stands."""

    def __init__(self, timeout_s: float) -> None:
        self.succeeded = False
        self._clock = Clock(limit_of(timeout_sec=timeout_s))

    def step(self, state: NedState) -> Command | None:
        """Return the descent; None on the ground, or when the time is over."""
        if self._clock.over(state.t_ns):
            return None
        if state.landed:
            self.succeeded = True
            return None
        return Command(v_xy_mps=(0.0, 0.0), vz_mps=LANDING_SPEED_MPS, yaw_rate_radps=0.0)
