"""Makes set-points from desired states: follows them, holds the position, or stops when the companion falls silent.

    no desired state yet          hold the position that the vehicle had when the set-points began
    one that moves (`moves`)      fly it until the next one
    one that does not             hold the position commanded last, or the vehicle's own, with the desired yaw
    none new for `stale_ns`       hold the same position, with the yaw commanded last, and warn once

A desired state is valid for one instant: that of the frame which it answers. Its rates extrapolate it to the instant t
of each set-point (`extrapolated`), unless it has `hold`. So it makes little difference which of two frames an answer
belongs to, and which set-point carries it first.

Set-points are NED and FRD; yaw from north, clockwise, in [-pi, pi]. The type masks exclude exactly the values that are
not given. PX4 and ArduPilot agree on all of this except the thrust of SET_ATTITUDE_TARGET, which ArduPilot takes as a
climb rate (0.5: none) unless GUID_OPTIONS has bit 3 (8) set.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.projections import AutopilotFrame
from firmware_bridge.ground_station.vehicle_link import VehicleLink
from signals.desired import DesiredState, extrapolated
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.rotation import yaw_of
from signals.samples import Vec3
from signals.time import NS_PER_S

_PositionTarget = message_class("SET_POSITION_TARGET_LOCAL_NED")
_AttitudeTarget = message_class("SET_ATTITUDE_TARGET")

_LOCAL_NED = 1  # MAV_FRAME
# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK: the values to ignore
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW, _NO_YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
_NO_RATES, _NO_ATTITUDE = 0x07, 0x80

_ZERO: Vec3 = (0.0, 0.0, 0.0)


class Applied(NamedTuple):
    """A desired state, the time from which it applies, and the instant for which it was computed [ns]."""

    t_apply_ns: int
    desired: DesiredState
    t_valid_ns: int


class DesiredQueue:
    """Desired states to come, and the one that applies."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, DesiredState, int]] = []
        self._puts = 0
        self.current: Applied | None = None

    @property
    def next_ns(self) -> int | None:
        """The time from which the next one applies; None if none waits."""
        return self._heap[0][0] if self._heap else None

    def put(self, desired: DesiredState, t_apply_ns: int, t_valid_ns: int) -> None:
        """Add a desired state. Of two for the same time the later added one applies; older ones are ignored."""
        heapq.heappush(self._heap, (t_apply_ns, self._puts, desired, t_valid_ns))
        self._puts += 1

    def advance(self, t_ns: int) -> None:
        """Make `current` the newest desired state that applies at `t_ns`."""
        heap = self._heap
        while heap and heap[0][0] <= t_ns:
            t_apply_ns, _, desired, t_valid_ns = heapq.heappop(heap)
            if self.current is None or t_apply_ns >= self.current.t_apply_ns:
                self.current = Applied(t_apply_ns, desired, t_valid_ns)


class Follower:
    """Makes the set-points. `on_event(t_ns, kind, text)` gets an event when the companion falls silent or returns."""

    def __init__(
        self,
        link: VehicleLink,
        frame: AutopilotFrame,
        queue: DesiredQueue,
        *,
        stale_ns: int,
        on_event: Callable[[int, str, str], None],
    ) -> None:
        self._link, self._frame, self._queue = link, frame, queue
        self._stale_ns, self._on_event = stale_ns, on_event
        self.plain_masks = False  # ArduPilot ignores a position with an acceleration but no velocity
        self.stale = False
        self._hold_N: Vec3 | None = None  # the position held; None while moving
        self._yaw_N: float | None = None  # last commanded
        self._commanded_N: Vec3 | None = None  # last commanded position; None if the last command had none
        self._converted: tuple[DesiredState, Vec3] | None = None

    def message(self, t_ns: int) -> Any:
        """Return the set-point of `t_ns`. The autopilot's frame must be known."""
        self._queue.advance(t_ns)
        applied = self._queue.current
        if applied is None:
            return self._hold(t_ns, None)
        self._check_stale(t_ns, applied)
        if self.stale:
            return self._hold(t_ns, None)
        desired = self._at(t_ns, applied)
        if desired.thrust is not None:
            self._hold_N = self._commanded_N = self._yaw_N = None
            return attitude_target(self._link, t_ns, desired)
        yaw_N = heading_N(desired)
        self._yaw_N = yaw_N
        if not desired.moves:
            return self._hold(t_ns, desired)
        self._hold_N = None
        p_N = self._commanded_N = self._position(desired)
        v_N, a_N = _in_ned(desired.v_W), _in_ned(desired.a_W)
        if self.plain_masks and p_N is not None and v_N is None:
            a_N = None
        return position_target(
            self._link, t_ns, p_N=p_N, v_N=v_N, a_N=a_N, yaw_rad=yaw_N, yaw_rate_radps=_clockwise(desired)
        )

    def _check_stale(self, t_ns: int, applied: Applied) -> None:
        """Detect whether desired states still come, and report a change."""
        age_ns = t_ns - applied.t_apply_ns
        stale = age_ns >= self._stale_ns and not applied.desired.land
        if stale == self.stale:
            return
        self.stale = stale
        if stale:
            text = f"no desired state for {age_ns / NS_PER_S:.2f} s; holding position"
            self._on_event(t_ns, "warning", text)
        else:
            self._on_event(t_ns, "status", "desired states come again")

    def _hold(self, t_ns: int, desired: DesiredState | None) -> Any:
        if self._hold_N is None:
            self._hold_N = self._commanded_N if self._commanded_N is not None else self._frame.p_N
        rate_radps = None if desired is None else _clockwise(desired)
        return position_target(self._link, t_ns, p_N=self._hold_N, yaw_rad=self._yaw_N, yaw_rate_radps=rate_radps)

    @staticmethod
    def _at(t_ns: int, applied: Applied) -> DesiredState:
        desired = applied.desired
        if desired.hold or not desired.changes:
            return desired
        return extrapolated(desired, (t_ns - applied.t_valid_ns) / NS_PER_S)

    def _position(self, desired: DesiredState) -> Vec3 | None:
        p_W = desired.p_W
        if p_W is None:
            return None
        if self._converted is None or self._converted[0] is not desired:
            self._converted = (desired, self._frame.ned_from_W(p_W))
        return self._converted[1]

    def on_new_origin(self) -> None:
        """Drop positions in the frame of the old origin."""
        self._converted = self._hold_N = self._commanded_N = None


def _in_ned(vector_W: Vec3 | None) -> Vec3 | None:
    return None if vector_W is None else ned_from_enu(vector_W)


def _clockwise(desired: DesiredState) -> float | None:
    return None if desired.yaw_rate_radps is None else -desired.yaw_rate_radps


def position_target(
    link: VehicleLink,
    t_ns: int,
    *,
    p_N: Vec3 | None = None,
    v_N: Vec3 | None = None,
    a_N: Vec3 | None = None,
    yaw_rad: float | None = None,
    yaw_rate_radps: float | None = None,
) -> Any:
    """Return SET_POSITION_TARGET_LOCAL_NED. Angles in the autopilot's convention."""
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
        link.target_sysid,
        link.target_compid,
        _LOCAL_NED,
        mask,
        *(p_N or _ZERO),
        *(v_N or _ZERO),
        *(a_N or _ZERO),
        yaw_rad or 0.0,
        yaw_rate_radps or 0.0,
    )


def attitude_target(link: VehicleLink, t_ns: int, desired: DesiredState) -> Any:
    """Return SET_ATTITUDE_TARGET for a desired state with thrust."""
    q_WB, w_B = desired.q_WB, desired.w_B
    return _AttitudeTarget(
        _boot_ms(t_ns),
        link.target_sysid,
        link.target_compid,
        (_NO_ATTITUDE if q_WB is None else 0) | (_NO_RATES if w_B is None else 0),
        (1.0, 0.0, 0.0, 0.0) if q_WB is None else q_NF_from_q_WB(q_WB),
        *(_ZERO if w_B is None else frd_from_flu(w_B)),
        desired.thrust,
    )


def heading_N(desired: DesiredState) -> float | None:
    """Return the desired yaw, from north, clockwise [rad]: from `yaw_rad`, or else from `q_WB`."""
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
