"""Flies a companion computer's desired states: connects, arms at the first one, streams set-points, lands.

A function of (simulated time, frames received, desired states). `step` is called once per tick; set-points fall on
fixed ticks, independently of when frames and desired states come. Besides the phases of `phased_flight`:

    PREFLIGHT   until its pre-arm check passes and its local frame is known; PX4: set-points from then on; then until
                the companion's first desired state takes effect
    ARMING      PX4: mode OFFBOARD, arm. ArduPilot: mode GUIDED, arm, take-off
    FLYING      set-points; on ArduPilot once it has climbed to the take-off height, which they would interrupt
    LANDING     from the first desired state with `land`: the autopilot's own landing, which cannot be cancelled

A vehicle that leaves OFFBOARD by itself (a failsafe, a pilot at the sticks) stays in its new mode, with one event; its
landing ends the flight as usual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.follower import DesiredQueue, Follower
from firmware_bridge.ground_station.modes import mode_number, mode_params, mode_word, plain_word
from firmware_bridge.ground_station.phased_flight import Heartbeats, Phase, PhasedFlight
from firmware_bridge.ground_station.procedure import Step
from firmware_bridge.ground_station.projections import AutopilotFrame, GeodeticFromW, Projection
from firmware_bridge.ground_station.vehicle_link import refused
from signals.desired import DesiredState
from signals.time import NS_PER_S, is_due

_DO_SET_MODE = 176
_COMPONENT_ARM_DISARM = 400
_NAV_TAKEOFF = 22
_REQUEST_MESSAGE = 512

_RETRY_NS = NS_PER_S
_ORIGIN_TRIES = 5
# PX4 enters OFFBOARD only where set-points have been coming for a while.
_STREAM_FIRST_NS = NS_PER_S
_CLIMBED_SHARE = 0.9  # of the take-off height, above which ArduPilot's take-off counts as flown


class OffboardPilot(PhasedFlight):
    """Flies desired states. Other settings as `PhasedFlight`.

    `geodetic_from_W` returns the place on Earth of a point in W. `projection`: the autopilot's (`projections`), None
    for that of the connected firmware; the mock identifies itself as PX4 but has another one. `on_event(t_ns, kind,
    text)` gets the pilot's events.
    """

    _streams = (
        (MSGID["SYS_STATUS"], 500_000.0),
        (MSGID["EXTENDED_SYS_STATE"], 200_000.0),
        (MSGID["LOCAL_POSITION_NED"], 100_000.0),
        (MSGID["GLOBAL_POSITION_INT"], 200_000.0),
        (MSGID["GPS_GLOBAL_ORIGIN"], 1_000_000.0),
    )
    waypoints = 0  # there is no mission: see `GroundStation`
    reached = 0
    set_points = 0  # sent so far
    requested_mode = ""  # word of the mode that somebody else has requested last

    def __init__(
        self,
        geodetic_from_W: GeodeticFromW,
        *,
        tick_ns: int,
        setpoint_hz: float = 50.0,
        stale_s: float = 1.0,
        takeoff_height_m: float = 2.0,
        projection: Projection | None = None,
        on_event: Callable[[int, str, str], None] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__((), **settings)
        self._tick_ns = tick_ns
        self._tick_millihz, self._setpoint_millihz = round(1000 * NS_PER_S / tick_ns), round(1000 * setpoint_hz)
        if not 2000 < self._setpoint_millihz <= self._tick_millihz:
            raise ValueError(
                f"set-points at {setpoint_hz:g} Hz on ticks at {self._tick_millihz / 1000:g} Hz: "
                "autopilots need more than 2 Hz, and there is at most one a tick; change setpoint_hz or tick_hz"
            )
        if not stale_s > 0.0 or not takeoff_height_m > 0.0:
            raise ValueError(f"stale_s ({stale_s:g}) and takeoff_height_m ({takeoff_height_m:g}) must be above 0")
        self._takeoff_height_m = takeoff_height_m
        self._on_event = on_event
        self._frame = AutopilotFrame(geodetic_from_W, projection)
        self._queue = DesiredQueue()
        self._stale_ns = round(stale_s * NS_PER_S)
        self._follower = Follower(self._link, self._frame, self._queue, stale_ns=self._stale_ns, on_event=self._report)
        self._origin_tries = 0
        self._not_ready_since_ns: int | None = None
        self._streaming_since_ns: int | None = None  # set-points; None: none are sent
        self._ground_d_m = 0.0  # D of the place where it was armed
        self._in_mode: bool | None = None  # from its heartbeat; None before it was first in the mode
        self._handlers |= {
            MSGID["LOCAL_POSITION_NED"]: self._frame.on_local_position,
            MSGID["GLOBAL_POSITION_INT"]: self._frame.on_global_position,
            MSGID["GPS_GLOBAL_ORIGIN"]: self._on_origin,
        }

    @property
    def ready(self) -> bool:
        """True once the autopilot would arm, and from then on."""
        if self.phase is not Phase.PREFLIGHT:
            return self.phase is not Phase.CONNECTING
        if self._not_ready_since_ns is not None or not self._frame.known:
            return False
        streaming = self._streaming_since_ns
        return self._heartbeats.firmware.arms_in_guided or (
            streaming is not None and self._t_ns >= streaming + _STREAM_FIRST_NS
        )

    @property
    def stale(self) -> bool:
        """True while no new desired states come and the vehicle holds its position."""
        return self._follower.stale

    def set_desired(self, desired: DesiredState, t_apply_ns: int, t_valid_ns: int | None = None) -> None:
        """Apply `desired` from the first step with t_ns >= `t_apply_ns` until the next one applies.

        `t_valid_ns`: the instant for which it was computed, that of the frame it answers; None: `t_apply_ns`.
        """
        self._queue.put(desired, t_apply_ns, t_apply_ns if t_valid_ns is None else t_valid_ns)
        self._due_ns = min(self._due_ns, t_apply_ns)

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`. Return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        if self._link.dispatch(frames, self._handlers) or t_ns >= self._due_ns:
            self._queue.advance(t_ns)
            self._decide(t_ns)
            self._decide_by(self._queue.next_ns)
        # Set-points leave one tick after frames do, so that the answer to a frame is sent at once.
        behind = t_ns // self._tick_ns - 1
        if self._streaming_since_ns is not None and is_due(
            behind, event_millihz=self._setpoint_millihz, tick_millihz=self._tick_millihz
        ):
            self._link.send(self._follower.message(t_ns))
            self.set_points += 1
        return self._link.take()

    # -- decisions ----------------------------------------------------------------------------------------------

    def _connecting(self, t_ns: int) -> None:
        if not self._connected(t_ns):
            return
        beat = self._heartbeats
        mode_number(beat.autopilot, "OFFBOARD", beat.vehicle_type)  # raises early if there is no such mode
        firmware = beat.firmware
        self._frame.project_as(firmware.project)
        self._follower.plain_masks = firmware.plain_masks
        self._enter(Phase.PREFLIGHT, t_ns)

    def _preflight(self, t_ns: int) -> None:
        healthy = self._health.ready(t_ns) and self.may_arm()
        if not (healthy and self._place_known(t_ns)):
            if self._not_ready_since_ns is None:
                self._not_ready_since_ns = t_ns
            problem = "it does not send its position (LOCAL_POSITION_NED)" if healthy else self._health.problem()
            self._check_preflight(t_ns, self._not_ready_since_ns, problem)
            return
        self._not_ready_since_ns = self._retry_ns = None
        if not self._heartbeats.firmware.arms_in_guided:
            if self._streaming_since_ns is None:
                self._streaming_since_ns = t_ns
            if t_ns < self._streaming_since_ns + _STREAM_FIRST_NS:
                self._retry_ns = self._streaming_since_ns + _STREAM_FIRST_NS
                return
        applied = self._queue.current
        # Only a recent state that moves starts the motors.
        if applied is None or applied.desired.land or not applied.desired.moves or self._commands.busy:
            return
        if t_ns - applied.t_apply_ns >= self._stale_ns:
            return
        assert self._frame.p_N is not None
        self._ground_d_m = self._frame.p_N[2]
        steps = _start_steps(self._heartbeats, self._takeoff_height_m)
        self._requests.begin(t_ns, steps, self._preflight_limit_ns)
        self._enter(Phase.ARMING, t_ns)

    def _place_known(self, t_ns: int) -> bool:
        """Return True once position and origin are known. Requests a missing origin, and infers it in the end."""
        if self._frame.known:
            return True
        if self._frame.origin is not None or self._commands.busy or t_ns < (self._retry_ns or 0):
            return False
        if self._origin_tries < _ORIGIN_TRIES:
            self._origin_tries += 1
            self._retry_ns = t_ns + _RETRY_NS
            self._commands.send(t_ns, _REQUEST_MESSAGE, (float(MSGID["GPS_GLOBAL_ORIGIN"]),))
            return False
        self._retry_ns = t_ns + _RETRY_NS
        if not self._frame.infer_origin():
            return False
        self._report(
            t_ns, "status", "the autopilot does not send its origin: computed from its local and global position"
        )
        return True

    def _arming(self, t_ns: int) -> None:
        if self._requests.step(t_ns):
            self._enter(Phase.FLYING, t_ns)

    def _flying(self, t_ns: int) -> None:
        progress, armed = self._progress, self._heartbeats.armed
        if progress.flown and progress.on_ground and not armed:
            self._land_reached(t_ns)
            return
        self._check_mode(t_ns)
        if self._streaming_since_ns is None and self._climbed():
            self._streaming_since_ns = t_ns
        applied = self._queue.current
        if applied is not None and applied.desired.land and armed and not self._commands.busy:
            beat = self._heartbeats
            params = mode_params(beat.autopilot, "LAND", beat.vehicle_type)
            land = Step(f"enter mode {beat.firmware.auto}LAND", _DO_SET_MODE, params)
            self._requests.begin(t_ns, (land,), self._preflight_limit_ns)
            self._enter(Phase.LANDING, t_ns)
            return
        if not armed:
            if not progress.flown:
                why = "do the desired states lead up?"
                raise refused(f"the vehicle disarmed before it took off: {why}{self._texts.last()}")
            return  # it falls; the flight ends on the ground
        if not (progress.flown and self._streaming_since_ns is not None):
            self._check_takeoff(t_ns, "; do the desired states lead up?")

    def _climbed(self) -> bool:
        assert self._frame.p_N is not None
        return self._ground_d_m - self._frame.p_N[2] >= _CLIMBED_SHARE * self._takeoff_height_m

    def _check_mode(self, t_ns: int) -> None:
        beat = self._heartbeats
        in_mode = beat.custom_mode == mode_number(beat.autopilot, "OFFBOARD", beat.vehicle_type).custom_mode
        if in_mode == self._in_mode or (self._in_mode is None and not in_mode):
            return
        before, self._in_mode = self._in_mode, in_mode
        if before is None:
            return
        word = mode_word(beat.autopilot, beat.custom_mode, beat.vehicle_type)
        why = "as requested" if plain_word(self.requested_mode) == word else "by itself"
        text = f"the vehicle is in mode {word} again" if in_mode else f"the vehicle went to mode {word} {why}"
        self._report(
            t_ns, "status" if in_mode else "warning", text + ("" if in_mode else ": it does not follow set-points")
        )

    def _landing(self, t_ns: int) -> None:
        # OFFBOARD without set-points triggers a failsafe: they continue until the landing has begun.
        if self._requests.step(t_ns):
            self._streaming_since_ns = None
        if not self._heartbeats.armed:
            self._land_reached(t_ns)

    def _land_reached(self, t_ns: int) -> None:
        self._streaming_since_ns = None
        super()._land_reached(t_ns)

    # -- messages and events --------------------------------------------------------------------------------------

    def _on_origin(self, message: Any) -> None:
        before = self._frame.origin
        self._frame.on_origin(message)
        if before is not None and before != self._frame.origin:
            self._follower.on_new_origin()
            self._report(self._t_ns, "warning", "the autopilot has moved the origin of its local frame")

    def _report(self, t_ns: int, kind: str, text: str) -> None:
        if self._on_event is not None:
            self._on_event(t_ns, kind, text)


def _start_steps(beat: Heartbeats, height_m: float) -> tuple[Step, ...]:
    """Return the steps, in order, before set-points fly the vehicle."""
    arm = Step("arm", _COMPONENT_ARM_DISARM, (1.0,), arms=True)
    offboard = mode_params(beat.autopilot, "OFFBOARD", beat.vehicle_type)
    if beat.firmware.arms_in_guided:
        return (
            Step("enter mode GUIDED", _DO_SET_MODE, offboard),
            arm,
            Step(f"take off to {height_m:g} m", _NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)),
        )
    return (Step("enter mode OFFBOARD", _DO_SET_MODE, offboard), arm)
