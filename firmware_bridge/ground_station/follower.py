"""From desired states to the set-point that is due now: hold, follow, or stop when the companion falls silent.

    no desired state yet          hold the position that the vehicle had when the set-points began
    one that moves (`moves`)      fly it, again and again, until the next one
    one that does not             hold the position commanded last, or where the vehicle is, with the yaw wanted
    none new for `stale_ns`       the same, with the yaw commanded last, and say so once

A desired state speaks of one instant: that of the frame which it answers. What it says of change carries it on from
there to the instant t of each set-point (`carried_on`), unless it says `hold`. So it matters little which of two frames
an answer is to, and which set-point is the first to carry it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.ground_station.autopilot_frame import AutopilotFrame
from firmware_bridge.ground_station.desired_queue import Applied, DesiredQueue
from firmware_bridge.ground_station.set_points import attitude_target, heading_N, position_target
from firmware_bridge.ground_station.wire import Wire
from hil.signals.desired import DesiredState, carried_on
from hil.signals.frames import ned_from_enu
from hil.signals.samples import Vec3
from hil.signals.time import NS_PER_S


class Follower:
    """`tell(t_ns, kind, text)` hears that the companion has fallen silent, and that it is back."""

    def __init__(
        self,
        wire: Wire,
        frame: AutopilotFrame,
        queue: DesiredQueue,
        *,
        stale_ns: int,
        tell: Callable[[int, str, str], None],
    ) -> None:
        self._wire, self._frame, self._queue = wire, frame, queue
        self._stale_ns, self._tell = stale_ns, tell
        self.plain_masks = False  # ArduPilot: a position with an acceleration but no velocity is no set-point
        self.stale = False
        self._hold_N: Vec3 | None = None  # where it stays, while it stays
        self._yaw_N: float | None = None  # commanded last
        self._commanded_N: Vec3 | None = None  # position commanded last; None where that was no position
        self._converted: tuple[DesiredState, Vec3] | None = None

    def message(self, t_ns: int) -> Any:
        """The set-point of `t_ns`. The frame has to be known."""
        self._queue.advance(t_ns)
        applied = self._queue.current
        if applied is None:
            return self._stay(t_ns, None)
        self._watch(t_ns, applied)
        if self.stale:
            return self._stay(t_ns, None)
        desired = self._at(t_ns, applied)
        if desired.thrust is not None:
            self._hold_N = self._commanded_N = self._yaw_N = None
            return attitude_target(self._wire, t_ns, desired)
        yaw_N = heading_N(desired)
        self._yaw_N = yaw_N
        if not desired.moves:
            return self._stay(t_ns, desired)
        self._hold_N = None
        p_N = self._commanded_N = self._position(desired)
        v_N, a_N = _turned(desired.v_W), _turned(desired.a_W)
        if self.plain_masks and p_N is not None and v_N is None:
            a_N = None
        return position_target(
            self._wire, t_ns, p_N=p_N, v_N=v_N, a_N=a_N, yaw_rad=yaw_N, yaw_rate_radps=_clockwise(desired)
        )

    def _watch(self, t_ns: int, applied: Applied) -> None:
        """Is there still somebody who wants something?"""
        age_ns = t_ns - applied.t_apply_ns
        stale = age_ns >= self._stale_ns and not applied.desired.land
        if stale == self.stale:
            return
        self.stale = stale
        if stale:
            text = f"no desired state for {age_ns / NS_PER_S:.2f} s; holding position"
            self._tell(t_ns, "warning", text)
        else:
            self._tell(t_ns, "status", "desired states come again")

    def _stay(self, t_ns: int, desired: DesiredState | None) -> Any:
        if self._hold_N is None:
            self._hold_N = self._commanded_N if self._commanded_N is not None else self._frame.p_N
        rate_radps = None if desired is None else _clockwise(desired)
        return position_target(self._wire, t_ns, p_N=self._hold_N, yaw_rad=self._yaw_N, yaw_rate_radps=rate_radps)

    @staticmethod
    def _at(t_ns: int, applied: Applied) -> DesiredState:
        desired = applied.desired
        if desired.hold or not desired.changes:
            return desired
        return carried_on(desired, (t_ns - applied.t_of_ns) / NS_PER_S)

    def _position(self, desired: DesiredState) -> Vec3 | None:
        p_W = desired.p_W
        if p_W is None:
            return None
        if self._converted is None or self._converted[0] is not desired:
            self._converted = (desired, self._frame.ned_from_W(p_W))
        return self._converted[1]

    def on_new_origin(self) -> None:
        """What was converted about the old origin, or heard in its frame, holds no more."""
        self._converted = self._hold_N = self._commanded_N = None


def _turned(vector_W: Vec3 | None) -> Vec3 | None:
    return None if vector_W is None else ned_from_enu(vector_W)


def _clockwise(desired: DesiredState) -> float | None:
    return None if desired.yaw_rate_radps is None else -desired.yaw_rate_radps
