"""Flies what a companion computer wants: connects, arms at its first desired state, streams set-points, lands.

A pure function of (simulated time, frames received, desired states), as the ground station is: no I/O and no clock of
its own. `step` is called once per tick; set-points fall on fixed ticks whatever was heard or wanted when.

    CONNECTING  until the vehicle's first heartbeat; then asks for the telemetry needed here
    PREFLIGHT   until its pre-arm check passes and its local frame is known; PX4: set-points from then on; then until
                the companion's first desired state takes effect
    ARMING      PX4: mode OFFBOARD, arm. ArduPilot: mode GUIDED, arm, take-off
    FLYING      set-points; on ArduPilot once it has climbed to the take-off height, which they would interrupt
    LANDING     from the first desired state that says so: the autopilot's own landing. There is no way back
    LANDED      disarmed; one more second, for what the vehicle still has to say
    DONE        only heartbeats

A vehicle that leaves OFFBOARD by itself (a failsafe, a pilot at the sticks) is not called back: that is said once, and
its landing ends the flight all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.asking import Asking
from firmware_bridge.ground_station.autopilot_frame import AutopilotFrame, GeodeticFromW
from firmware_bridge.ground_station.commands import Commands
from firmware_bridge.ground_station.desired_queue import DesiredQueue
from firmware_bridge.ground_station.follower import Follower
from firmware_bridge.ground_station.health import Health
from firmware_bridge.ground_station.heartbeat import Heartbeats
from firmware_bridge.ground_station.modes import ARDUPILOT, mode_number, mode_params, mode_word
from firmware_bridge.ground_station.procedure import Step
from firmware_bridge.ground_station.progress import Progress
from firmware_bridge.ground_station.projections import Projection
from firmware_bridge.ground_station.status_texts import StatusTexts
from firmware_bridge.ground_station.wire import Wire, refused
from hil.signals.desired import DesiredState
from hil.signals.time import NS_PER_S, is_due

_DO_SET_MODE = 176
_COMPONENT_ARM_DISARM = 400
_NAV_TAKEOFF = 22
_SET_MESSAGE_INTERVAL = 511
_REQUEST_MESSAGE = 512

# (message, interval [us]): what the phases wait for, and where the vehicle is.
_STREAMS = (
    (MSGID["SYS_STATUS"], 500_000.0),
    (MSGID["EXTENDED_SYS_STATE"], 200_000.0),
    (MSGID["LOCAL_POSITION_NED"], 100_000.0),
    (MSGID["GLOBAL_POSITION_INT"], 200_000.0),
    (MSGID["GPS_GLOBAL_ORIGIN"], 1_000_000.0),
)

_RETRY_NS = NS_PER_S
_SETTLE_NS = NS_PER_S
_ORIGIN_TRIES = 5
# PX4 enters OFFBOARD only where set-points have been coming for a while.
_STREAM_FIRST_NS = NS_PER_S
_CLIMBED = 0.9  # part of the take-off height, above which ArduPilot's take-off counts as flown


class PilotPhase(Enum):
    """Where the pilot stands. The order is that of a flight."""

    CONNECTING = "connecting"
    PREFLIGHT = "preflight"
    ARMING = "arming"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    DONE = "done"


class OffboardPilot:
    """Flies vehicle `target_sysid`, None being the first autopilot heard. All limits are simulated time.

    `geodetic_from_W` tells where on Earth a point of the world is. `projection`: the autopilot's map of the Earth
    (`projections`), None for the one of the firmware heard; the mock passes for a PX4 and has another one.
    `on_event(t_ns, kind, text)` hears what the pilot has to say. With `grid_ns`, decisions fall on multiples of it
    only. HandshakeError says what was asked, what was answered, and what to do.
    """

    waypoints = 0  # for those who show the progress of a mission
    reached = 0
    set_points = 0  # sent so far

    def __init__(
        self,
        geodetic_from_W: GeodeticFromW,
        *,
        tick_ns: int,
        setpoint_hz: float = 50.0,
        stale_s: float = 1.0,
        takeoff_height_m: float = 2.0,
        projection: Projection | None = None,
        target_sysid: int | None = 1,
        target_compid: int = 1,
        heartbeat_limit_s: float = 30.0,
        preflight_limit_s: float = 60.0,
        takeoff_limit_s: float = 60.0,
        grid_ns: int = 0,
        on_event: Callable[[int, str, str], None] | None = None,
    ) -> None:
        self._tick_ns = tick_ns
        self._tick_mhz, self._setpoint_mhz = round(1000 * NS_PER_S / tick_ns), round(1000 * setpoint_hz)
        if not 2000 < self._setpoint_mhz <= self._tick_mhz:
            raise ValueError(
                f"set-points at {setpoint_hz:g} Hz on ticks at {self._tick_mhz / 1000:g} Hz: "
                "autopilots want more than 2 Hz, and there is at most one a tick"
            )
        if not stale_s > 0.0 or not takeoff_height_m > 0.0:
            raise ValueError(f"stale_s ({stale_s:g}) and takeoff_height_m ({takeoff_height_m:g}) have to be above 0")
        self._takeoff_height_m = takeoff_height_m
        self._heartbeat_limit_ns = round(heartbeat_limit_s * NS_PER_S)
        self._preflight_limit_ns = round(preflight_limit_s * NS_PER_S)
        self._takeoff_limit_ns = round(takeoff_limit_s * NS_PER_S)
        self._grid_ns = grid_ns
        self._grid_cell = -1  # in which it last decided
        self._on_event = on_event
        self._wire = Wire(target_sysid=target_sysid or 0, target_compid=target_compid)
        self._heartbeats = Heartbeats(self._wire)
        self._commands = Commands(self._wire)
        self._health = Health()
        self._progress = Progress(())
        self._texts = StatusTexts()
        self._asking = Asking(self._commands, self._heartbeats, self._texts)
        self._frame = AutopilotFrame(geodetic_from_W, projection)
        self._queue = DesiredQueue()
        self._stale_ns = round(stale_s * NS_PER_S)
        self._follower = Follower(
            self._wire,
            self._frame,
            self._queue,
            stale_ns=round(stale_s * NS_PER_S),
            tell=self._tell,
        )
        self.phase = PilotPhase.CONNECTING
        self._phase_since_ns = 0
        self._retry_ns: int | None = None
        self._streams_asked = 0
        self._origin_tries = 0
        self._unfit_since_ns: int | None = None
        self._streaming_since_ns: int | None = None  # set-points; None: none are sent
        self._ground_d_m = 0.0  # height of the place where it was armed
        self._in_mode: bool | None = None  # as its heartbeat shows; None until it first shows it
        self._t_ns = 0
        self._started = False
        self._due_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._heartbeats.on_heartbeat,
            MSGID["COMMAND_ACK"]: lambda m: self._commands.on_ack(self._t_ns, m),
            MSGID["SYS_STATUS"]: self._health.on_sys_status,
            MSGID["EXTENDED_SYS_STATE"]: self._progress.on_extended_sys_state,
            MSGID["STATUSTEXT"]: lambda m: self._texts.on_statustext(self._t_ns, m),
            MSGID["LOCAL_POSITION_NED"]: self._frame.on_local_position,
            MSGID["GLOBAL_POSITION_INT"]: self._frame.on_global_position,
            MSGID["GPS_GLOBAL_ORIGIN"]: self._on_origin,
        }

    @property
    def statustexts(self) -> list[tuple[int, int, str]]:
        """(t_ns, MAV_SEVERITY, text) of everything the vehicle has said in words."""
        return self._texts.texts

    @property
    def armed(self) -> bool:
        return self._heartbeats.armed

    @property
    def stale(self) -> bool:
        """The companion has wanted nothing new for too long, and the vehicle holds its position."""
        return self._follower.stale

    def set_desired(self, desired: DesiredState, t_apply_ns: int, t_of_ns: int | None = None) -> None:
        """`desired` counts from the first step with t_ns >= `t_apply_ns` on, until the next one does.

        `t_of_ns`: the instant that it speaks of, that of the frame it answers; None: when it begins to count.
        """
        self._queue.put(desired, t_apply_ns, t_apply_ns if t_of_ns is None else t_of_ns)
        self._due_ns = min(self._due_ns, t_apply_ns)

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`; return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        if self._wire.hand_on(frames, self._handlers) or t_ns >= self._due_ns:
            self._decide(t_ns)
        # A tick after the grid on which frames leave: what was desired in answer to a frame is sent at once.
        behind = t_ns // self._tick_ns - 1
        if self._streaming_since_ns is not None and is_due(
            behind, event_mhz=self._setpoint_mhz, tick_mhz=self._tick_mhz
        ):
            self._wire.say(self._follower.message(t_ns))
            self.set_points += 1
        return self._wire.take()

    # -- decisions ----------------------------------------------------------------------------------------------

    def _decide(self, t_ns: int) -> None:
        if not self._started:
            self._started = True
            self._heartbeats.due_ns = self._phase_since_ns = t_ns
        self._heartbeats.step(t_ns)
        self._queue.advance(t_ns)
        cell = t_ns // self._grid_ns if self._grid_ns else -1
        decides = cell < 0 or cell != self._grid_cell
        self._grid_cell = cell
        before = None
        while decides and before is not self.phase:
            before = self.phase
            _PHASES[before](self, t_ns)
        self._commands.step(t_ns)
        dues = (
            self._heartbeats.due_ns,
            self._commands.due_ns,
            self._retry_ns,
            self._asking.retry_ns,
            self._queue.next_ns,
            (cell + 1) * self._grid_ns if self._grid_ns else None,
        )
        self._due_ns = min(due for due in dues if due is not None)

    def _enter(self, phase: PilotPhase, t_ns: int) -> None:
        self.phase = phase
        self._phase_since_ns = t_ns
        self._retry_ns = None

    def _whom(self) -> str:
        sysid = self._wire.target_sysid
        return f"vehicle {sysid}" if sysid else "any autopilot"

    def _connecting(self, t_ns: int) -> None:
        if not self._heartbeats.connected:
            if t_ns - self._phase_since_ns >= self._heartbeat_limit_ns:
                raise refused(
                    f"no heartbeat of {self._whom()} within "
                    f"{self._heartbeat_limit_ns / NS_PER_S:g} s of simulated time; has it another system id?"
                )
            return
        if self._commands.busy:
            return
        # Whether a stream was granted does not matter here: the phases that need it say so if it never comes.
        if self._streams_asked < len(_STREAMS):
            msgid, interval_us = _STREAMS[self._streams_asked]
            self._streams_asked += 1
            self._commands.ask(t_ns, _SET_MESSAGE_INTERVAL, (float(msgid), interval_us))
            return
        autopilot = self._heartbeats.autopilot
        mode_number(autopilot, "OFFBOARD")  # known before it is needed, or refused
        self._frame.settle(autopilot)
        self._follower.plain_masks = autopilot == ARDUPILOT
        self._enter(PilotPhase.PREFLIGHT, t_ns)

    def _preflight(self, t_ns: int) -> None:
        healthy = self._health.ready(t_ns)
        if not (healthy and self._place_known(t_ns)):
            if self._unfit_since_ns is None:
                self._unfit_since_ns = t_ns
            if t_ns - self._unfit_since_ns >= self._preflight_limit_ns:
                complaint = "it does not tell where it is (LOCAL_POSITION_NED)" if healthy else self._health.complaint()
                raise refused(
                    f"the vehicle is not ready to arm after {self._preflight_limit_ns / NS_PER_S:g} s of simulated "
                    f"time: {complaint}{self._texts.last()}"
                )
            return
        self._unfit_since_ns = self._retry_ns = None
        if self._heartbeats.autopilot != ARDUPILOT:
            if self._streaming_since_ns is None:
                self._streaming_since_ns = t_ns
            if t_ns < self._streaming_since_ns + _STREAM_FIRST_NS:
                self._retry_ns = self._streaming_since_ns + _STREAM_FIRST_NS
                return
        applied = self._queue.current
        # Only a state that leads somewhere, and is no old wish, sets the motors going.
        if applied is None or applied.desired.land or not applied.desired.moves or self._commands.busy:
            return
        if t_ns - applied.t_apply_ns >= self._stale_ns:
            return
        assert self._frame.p_N is not None
        self._ground_d_m = self._frame.p_N[2]
        steps = _into_the_air(self._heartbeats.autopilot, self._takeoff_height_m)
        self._asking.begin(t_ns, steps, self._preflight_limit_ns)
        self._enter(PilotPhase.ARMING, t_ns)

    def _place_known(self, t_ns: int) -> bool:
        """The vehicle's place and its origin; asks for the origin where it is not told, and does without in the end."""
        if self._frame.known:
            return True
        if self._frame.origin is not None or self._commands.busy or t_ns < (self._retry_ns or 0):
            return False
        if self._origin_tries < _ORIGIN_TRIES:
            self._origin_tries += 1
            self._retry_ns = t_ns + _RETRY_NS
            self._commands.ask(t_ns, _REQUEST_MESSAGE, (float(MSGID["GPS_GLOBAL_ORIGIN"]),))
            return False
        self._retry_ns = t_ns + _RETRY_NS
        if not self._frame.infer_origin():
            return False
        self._tell(t_ns, "status", "the autopilot does not tell its origin: taken from where it says that it is")
        return True

    def _arming(self, t_ns: int) -> None:
        if self._asking.step(t_ns):
            self._enter(PilotPhase.FLYING, t_ns)

    def _flying(self, t_ns: int) -> None:
        progress, armed = self._progress, self._heartbeats.armed
        if progress.flown and progress.on_ground and not armed:
            self._land_reached(t_ns)
            return
        self._watch_mode(t_ns)
        if self._streaming_since_ns is None and self._climbed():
            self._streaming_since_ns = t_ns
        applied = self._queue.current
        if applied is not None and applied.desired.land and armed and not self._commands.busy:
            mode = "AUTO.LAND" if self._heartbeats.autopilot != ARDUPILOT else "LAND"
            land = Step(f"enter mode {mode}", _DO_SET_MODE, mode_params(self._heartbeats.autopilot, "LAND"))
            self._asking.begin(t_ns, (land,), self._preflight_limit_ns)
            self._enter(PilotPhase.LANDING, t_ns)
            return
        if not armed:
            if not progress.flown:
                raise refused(f"the vehicle disarmed before it took off{self._texts.last()}")
            return  # it falls, and the flight is over once it lies
        in_air = progress.flown and self._streaming_since_ns is not None
        if not in_air and t_ns - self._phase_since_ns >= self._takeoff_limit_ns:
            raise refused(
                f"armed, but not in the air after {self._takeoff_limit_ns / NS_PER_S:g} s of simulated time; do the "
                f"desired states lead up?{self._texts.last()}"
            )

    def _climbed(self) -> bool:
        assert self._frame.p_N is not None
        return self._ground_d_m - self._frame.p_N[2] >= _CLIMBED * self._takeoff_height_m

    def _watch_mode(self, t_ns: int) -> None:
        beat = self._heartbeats
        in_mode = beat.custom_mode == mode_number(beat.autopilot, "OFFBOARD").custom_mode
        if in_mode == self._in_mode or (self._in_mode is None and not in_mode):
            return
        before, self._in_mode = self._in_mode, in_mode
        if before is None:
            return
        word = mode_word(beat.autopilot, beat.custom_mode)
        text = f"the vehicle is in mode {word} again" if in_mode else f"the vehicle went to mode {word} by itself"
        self._tell(t_ns, "status" if in_mode else "warning", text + ("" if in_mode else ": set-points do not fly it"))

    def _landing(self, t_ns: int) -> None:
        # OFFBOARD without set-points is a failsafe: they go on until the landing has begun.
        if self._asking.step(t_ns):
            self._streaming_since_ns = None
        if not self._heartbeats.armed:
            self._land_reached(t_ns)

    def _land_reached(self, t_ns: int) -> None:
        self._streaming_since_ns = None
        self._enter(PilotPhase.LANDED, t_ns)
        self._retry_ns = t_ns + _SETTLE_NS

    def _landed(self, t_ns: int) -> None:
        if self._retry_ns is not None and t_ns >= self._retry_ns:
            self._enter(PilotPhase.DONE, t_ns)

    def _done(self, t_ns: int) -> None:
        pass

    # -- what the vehicle says, and what is said of it ------------------------------------------------------------

    def _on_origin(self, message: Any) -> None:
        before = self._frame.origin
        self._frame.on_origin(message)
        if before is not None and before != self._frame.origin:
            self._follower.on_new_origin()
            self._tell(self._t_ns, "warning", "the autopilot has moved the origin of its local frame")

    def _tell(self, t_ns: int, kind: str, text: str) -> None:
        if self._on_event is not None:
            self._on_event(t_ns, kind, text)


def _into_the_air(autopilot: int, height_m: float) -> tuple[Step, ...]:
    """What to ask for, in order, before set-points fly the vehicle."""
    arm = Step("arm", _COMPONENT_ARM_DISARM, (1.0,), arms=True)
    if autopilot == ARDUPILOT:
        return (
            Step("enter mode GUIDED", _DO_SET_MODE, mode_params(autopilot, "GUIDED")),
            arm,
            Step(f"take off to {height_m:g} m", _NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)),
        )
    return (Step("enter mode OFFBOARD", _DO_SET_MODE, mode_params(autopilot, "OFFBOARD")), arm)


_PHASES: dict[PilotPhase, Callable[[OffboardPilot, int], None]] = {
    PilotPhase.CONNECTING: OffboardPilot._connecting,
    PilotPhase.PREFLIGHT: OffboardPilot._preflight,
    PilotPhase.ARMING: OffboardPilot._arming,
    PilotPhase.FLYING: OffboardPilot._flying,
    PilotPhase.LANDING: OffboardPilot._landing,
    PilotPhase.LANDED: OffboardPilot._landed,
    PilotPhase.DONE: OffboardPilot._done,
}
