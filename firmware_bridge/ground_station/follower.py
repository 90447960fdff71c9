"""From desired states to the set-point that is due now: hold, follow, or stop when the companion falls silent.

    no desired state yet          hold the position that the vehicle had when the set-points began
    one that moves (`moves`)      fly it, again and again, until the next one
    one that does not             hold the position commanded last, or where the vehicle is, with the yaw wanted
    none new for `stale_ns`       the same, with the yaw commanded last, and say so once

A desired state speaks of one instant: that of the frame which it answers. What it says of change carries it on from
there to the instant t of each set-point (`carried_on`), unless it says `hold`. So it matters little which of two frames
an answer is to, and which set-point is the first to carry it.

Set-points are NED and FRD; yaw from north, clockwise, in [-pi, pi]. The type masks name exactly what is not given;
nothing given is left to the autopilot. PX4 and ArduPilot agree on all of it but for the thrust of SET_ATTITUDE_TARGET,
which ArduPilot takes as a climb rate (0.5: none) unless GUID_OPTIONS has bit 3 (8) set.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.projections import AutopilotFrame
from firmware_bridge.ground_station.wire import Wire
from hil.signals.desired import DesiredState, carried_on
from hil.signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from hil.signals.rotation import yaw_of
from hil.signals.samples import Vec3
from hil.signals.time import NS_PER_S

_PositionTarget = message_class("SET_POSITION_TARGET_LOCAL_NED")
_AttitudeTarget = message_class("SET_ATTITUDE_TARGET")

_LOCAL_NED = 1  # MAV_FRAME
# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK: what to ignore
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW, _NO_YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
_NO_RATES, _NO_ATTITUDE = 0x07, 0x80

_NOTHING: Vec3 = (0.0, 0.0, 0.0)


class Applied(NamedTuple):
    """A desired state, from when on it counts, and the time that it speaks of [ns]."""

    t_apply_ns: int
    desired: DesiredState
    t_of_ns: int


class DesiredQueue:
    """Keeps those to come and the one that counts."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, DesiredState, int]] = []
        self._puts = 0
        self.current: Applied | None = None

    @property
    def next_ns(self) -> int | None:
        """When the next one takes effect; None if none waits."""
        return self._heap[0][0] if self._heap else None

    def put(self, desired: DesiredState, t_apply_ns: int, t_of_ns: int) -> None:
        """Of two for the same time the one put later counts; one for an earlier time than what counts is too late."""
        heapq.heappush(self._heap, (t_apply_ns, self._puts, desired, t_of_ns))
        self._puts += 1

    def advance(self, t_ns: int) -> None:
        """Make `current` the newest that applies at `t_ns`."""
        heap = self._heap
        while heap and heap[0][0] <= t_ns:
            t_apply_ns, _, desired, t_of_ns = heapq.heappop(heap)
            if self.current is None or t_apply_ns >= self.current.t_apply_ns:
                self.current = Applied(t_apply_ns, desired, t_of_ns)


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


def position_target(
    wire: Wire,
    t_ns: int,
    *,
    p_N: Vec3 | None = None,
    v_N: Vec3 | None = None,
    a_N: Vec3 | None = None,
    yaw_rad: float | None = None,
    yaw_rate_radps: float | None = None,
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED. Angles as the autopilot has them."""
    mask = 0
    for value, bits in (
        (p_N, _NO_POSITION),
        (v_N, _NO_VELOCITY),
        (a_N, _NO_ACCELERATION),
        (yaw_rad, _NO_YAW),
        (yaw_rate_radps, _NO_YAW_RATE),
    ):
        if value is None:
            mask |= bits
    return _PositionTarget(
        _boot_ms(t_ns),
        wire.target_sysid,
        wire.target_compid,
        _LOCAL_NED,
        mask,
        *(p_N or _NOTHING),
        *(v_N or _NOTHING),
        *(a_N or _NOTHING),
        yaw_rad or 0.0,
        yaw_rate_radps or 0.0,
    )


def attitude_target(wire: Wire, t_ns: int, desired: DesiredState) -> Any:
    """SET_ATTITUDE_TARGET of a desired state with thrust."""
    q_WB, w_B = desired.q_WB, desired.w_B
    return _AttitudeTarget(
        _boot_ms(t_ns),
        wire.target_sysid,
        wire.target_compid,
        (_NO_ATTITUDE if q_WB is None else 0) | (_NO_RATES if w_B is None else 0),
        (1.0, 0.0, 0.0, 0.0) if q_WB is None else q_NF_from_q_WB(q_WB),
        *(_NOTHING if w_B is None else frd_from_flu(w_B)),
        desired.thrust,
    )


def heading_N(desired: DesiredState) -> float | None:
    """The yaw that is wanted, from north, clockwise: of `yaw_rad`, or else of `q_WB`."""
    yaw_rad = desired.yaw_rad
    if yaw_rad is None:
        if desired.q_WB is None:
            return None
        yaw_rad = yaw_of(desired.q_WB)
    angle = 0.5 * pi - yaw_rad
    if -pi <= angle <= pi:
        return angle
    return angle - 2.0 * pi * ((angle + pi) // (2.0 * pi))


def _boot_ms(t_ns: int) -> int:
    return t_ns // 1_000_000 & 0xFFFFFFFF
