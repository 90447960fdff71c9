"""The bench's ground station: connects, uploads the mission, starts it, watches it, sees it landed.

A pure function of (simulated time, frames received): no I/O and no clock of its own, so that a run with it
is as repeatable as one without. `step` is called once per tick with everything received during the last one
and returns the bytes to send in this one; it costs about a microsecond when there is nothing to do.

    CONNECTING  until the vehicle's first heartbeat; then asks for the telemetry needed here
    UPLOADING   the mission protocol
    PREFLIGHT   until the vehicle's pre-arm check passes
    ARMING      the steps into the air (`procedure`), each asked again while the vehicle declines for now
    FLYING      until it has flown, is on the ground and has disarmed
    LANDED      one more second, for what the vehicle still has to say
    DONE        only heartbeats
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.asking import Asking
from firmware_bridge.ground_station.commands import Commands
from firmware_bridge.ground_station.health import Health
from firmware_bridge.ground_station.heartbeat import Heartbeats
from firmware_bridge.ground_station.mission_upload import MissionUpload
from firmware_bridge.ground_station.modes import ARDUPILOT, mode_params
from firmware_bridge.ground_station.procedure import first_seq, items_for, start_steps
from firmware_bridge.ground_station.progress import Progress
from firmware_bridge.ground_station.status_texts import StatusTexts
from firmware_bridge.ground_station.wire import Wire, refused
from hil.signals.mission import MissionItem
from hil.signals.time import NS_PER_S

_SET_MESSAGE_INTERVAL = 511
_DO_SET_MODE = 176

# (message, interval [us]): what the phases wait for, often enough that they never wait long.
_STREAMS = (
    (MSGID["SYS_STATUS"], 500_000.0),
    (MSGID["EXTENDED_SYS_STATE"], 200_000.0),
    (MSGID["MISSION_CURRENT"], 500_000.0),
)

_SETTLE_NS = NS_PER_S


class Phase(Enum):
    """Where the ground station stands. The order is that of a flight."""

    CONNECTING = "connecting"
    UPLOADING = "uploading"
    PREFLIGHT = "preflight"
    ARMING = "arming"
    FLYING = "flying"
    LANDED = "landed"
    DONE = "done"


class GroundStation:
    """Flies `mission` on vehicle `target_sysid`, None being the first autopilot heard. All limits are simulated time.

    HandshakeError says what was asked, what was answered, and what to do. A mission whose last item is
    neither a landing nor a return is landed where it ends, by mode AUTO.LAND, unless `land_at_end` is
    False. With `grid_ns`, decisions fall on multiples of it only, whenever what they rest on was heard.
    """

    def __init__(
        self,
        mission: Sequence[MissionItem],
        *,
        target_sysid: int | None = 1,
        target_compid: int = 1,
        heartbeat_limit_s: float = 30.0,
        preflight_limit_s: float = 60.0,
        takeoff_limit_s: float = 60.0,
        land_at_end: bool = True,
        fly: bool = True,
        grid_ns: int = 0,
    ) -> None:
        if fly and not mission:
            raise refused("the mission has no items; there is nothing to fly")
        self._wire = Wire(target_sysid=target_sysid or 0, target_compid=target_compid)
        self._heartbeat_limit_ns = round(heartbeat_limit_s * NS_PER_S)
        self._preflight_limit_ns = round(preflight_limit_s * NS_PER_S)
        self._takeoff_limit_ns = round(takeoff_limit_s * NS_PER_S)
        self._heartbeats = Heartbeats(self._wire)
        self._commands = Commands(self._wire)
        self._mission = tuple(mission)
        self._upload = MissionUpload(self._wire, mission)
        self._health = Health()
        self._progress = Progress(mission)
        self._texts = StatusTexts()
        self._fly = fly
        self._grid_ns = grid_ns
        self._grid_cell = -1  # in which it last decided
        self._must_land = fly and land_at_end and not self._progress.lands_by_itself
        self.phase = Phase.CONNECTING
        self._phase_since_ns = 0
        self._preflight_since_ns = 0
        self._streams_asked = 0
        self._asking = Asking(self._commands, self._heartbeats, self._texts)  # for the steps into the air
        self._landed_ns: int | None = None  # when it has said all
        self._t_ns = 0
        self._started = False
        self._due_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._heartbeats.on_heartbeat,
            MSGID["COMMAND_ACK"]: lambda m: self._commands.on_ack(self._t_ns, m),
            MSGID["MISSION_REQUEST_INT"]: lambda m: self._upload.on_request(self._t_ns, m),
            MSGID["MISSION_REQUEST"]: lambda m: self._upload.on_request(self._t_ns, m),
            MSGID["MISSION_ACK"]: self._upload.on_ack,
            MSGID["MISSION_CURRENT"]: self._progress.on_mission_current,
            MSGID["MISSION_ITEM_REACHED"]: self._progress.on_item_reached,
            MSGID["SYS_STATUS"]: self._health.on_sys_status,
            MSGID["EXTENDED_SYS_STATE"]: self._progress.on_extended_sys_state,
            MSGID["STATUSTEXT"]: lambda m: self._texts.on_statustext(self._t_ns, m),
        }

    @property
    def waypoints(self) -> int:
        """Navigation items of the mission that have a place."""
        return self._progress.waypoints

    @property
    def reached(self) -> int:
        """Those of them that the vehicle has reported as reached."""
        return self._progress.reached

    @property
    def mission_completed(self) -> bool:
        """Every waypoint reached, or the vehicle has said that the mission is complete."""
        return self._progress.completed

    @property
    def statustexts(self) -> list[tuple[int, int, str]]:
        """(t_ns, MAV_SEVERITY, text) of everything the vehicle has said in words."""
        return self._texts.texts

    @property
    def armed(self) -> bool:
        return self._heartbeats.armed

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`; return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        if not self._wire.hand_on(frames, self._handlers) and t_ns < self._due_ns:
            return b""
        if not self._started:
            self._started = True
            self._heartbeats.due_ns = self._phase_since_ns = t_ns
        self._heartbeats.step(t_ns)
        cell = t_ns // self._grid_ns if self._grid_ns else -1
        decides = cell < 0 or cell != self._grid_cell
        self._grid_cell = cell
        before = None
        while decides and before is not self.phase:
            before = self.phase
            _PHASES[before](self, t_ns)
        self._commands.step(t_ns)
        self._upload.step(t_ns)
        asked = (self._heartbeats.due_ns, self._commands.due_ns, self._upload.due_ns)
        dues = (*asked, self._asking.retry_ns, self._landed_ns)
        self._due_ns = min(due for due in dues if due is not None)
        if self._grid_ns:
            self._due_ns = min(self._due_ns, (cell + 1) * self._grid_ns)
        return self._wire.take()

    def _whom(self) -> str:
        sysid = self._wire.target_sysid
        return f"vehicle {sysid}" if sysid else "any autopilot"

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase = phase
        self._phase_since_ns = t_ns
        self._commands.result = None  # an answer to the last phase's question answers none of this one's

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
        if self._fly:
            autopilot = self._heartbeats.autopilot
            self._progress.first_seq = first_seq(autopilot)
            self._upload.start(t_ns, items_for(autopilot, self._mission), patient=autopilot == ARDUPILOT)
            self._enter(Phase.UPLOADING, t_ns)
        else:
            self._enter(Phase.ARMING, t_ns)

    def _uploading(self, t_ns: int) -> None:
        if self._upload.done:
            self._preflight_since_ns = t_ns
            self._enter(Phase.PREFLIGHT, t_ns)

    def _preflight(self, t_ns: int) -> None:
        if self._health.ready(t_ns):
            self._enter(Phase.ARMING, t_ns)
            steps = start_steps(self._heartbeats.autopilot)
            self._asking.begin(self._preflight_since_ns, steps, self._preflight_limit_ns)
        elif t_ns - self._preflight_since_ns >= self._preflight_limit_ns:
            raise refused(
                f"the vehicle is not ready to arm after {self._preflight_limit_ns / NS_PER_S:g} s of simulated time: "
                f"{self._health.complaint()}{self._texts.last()}"
            )

    def _arming(self, t_ns: int) -> None:
        if not self._asking.step(t_ns):
            return
        if self._heartbeats.armed:
            self._enter(Phase.FLYING, t_ns)
        elif self._fly and t_ns - self._preflight_since_ns >= self._preflight_limit_ns:
            raise refused(f"the vehicle took the mission, but is not armed and does not fly{self._texts.last(6)}")

    def _flying(self, t_ns: int) -> None:
        progress = self._progress
        if not progress.flown:
            if not self._fly:
                if not self._heartbeats.armed:
                    self._enter(Phase.ARMING, t_ns)
                return
            if t_ns - self._phase_since_ns >= self._takeoff_limit_ns:
                raise refused(
                    f"armed, but not in the air after {self._takeoff_limit_ns / NS_PER_S:g} s of simulated time"
                    f"{self._texts.last()}"
                )
            if not self._heartbeats.armed:
                raise refused(f"the vehicle disarmed before it took off{self._texts.last()}")
            return
        if progress.on_ground and not self._heartbeats.armed:
            progress.on_landed()
            self._enter(Phase.LANDED, t_ns)
            self._landed_ns = t_ns + _SETTLE_NS
        elif self._must_land and progress.completed and not self._commands.busy:
            self._must_land = False
            self._commands.ask(t_ns, _DO_SET_MODE, mode_params(self._heartbeats.autopilot, "LAND"))

    def _landed(self, t_ns: int) -> None:
        if self._landed_ns is not None and t_ns >= self._landed_ns:
            self._landed_ns = None
            self._enter(Phase.DONE, t_ns)

    def _done(self, t_ns: int) -> None:
        pass


_PHASES: dict[Phase, Callable[[GroundStation, int], None]] = {
    Phase.CONNECTING: GroundStation._connecting,
    Phase.UPLOADING: GroundStation._uploading,
    Phase.PREFLIGHT: GroundStation._preflight,
    Phase.ARMING: GroundStation._arming,
    Phase.FLYING: GroundStation._flying,
    Phase.LANDED: GroundStation._landed,
    Phase.DONE: GroundStation._done,
}
