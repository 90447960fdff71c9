"""The bench's ground station: connects, uploads the mission, starts it, and monitors it until it has landed.

`step` is called once per tick with the frames received during the last one and returns the bytes to send in this one.
Besides the phases of `phased_flight`:

    UPLOADING   the mission protocol
    PREFLIGHT   until the vehicle's pre-arm check passes
    ARMING      the steps of the start (`procedure`), each repeated while the vehicle declines it temporarily
    FLYING      until it has flown, is on the ground and has disarmed
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.mission_upload import MissionUpload
from firmware_bridge.ground_station.modes import mode_params
from firmware_bridge.ground_station.phased_flight import Phase, PhasedFlight
from firmware_bridge.ground_station.procedure import items_for, start_steps
from firmware_bridge.ground_station.vehicle_link import refused
from signals.mission import MissionItem
from signals.time import NS_PER_S

_MissionSetCurrent = message_class("MISSION_SET_CURRENT")
_DO_SET_MODE = 176
_ABORTED = "takeoff aborted"


class GroundStation(PhasedFlight):
    """Flies `mission`, or with `fly` False only monitors the flight. Other settings as `PhasedFlight`.

    After a mission whose last item is neither a landing nor a return, the vehicle lands in mode AUTO.LAND.
    """

    _streams = (
        (MSGID["SYS_STATUS"], 500_000.0),
        (MSGID["EXTENDED_SYS_STATE"], 200_000.0),
        (MSGID["MISSION_CURRENT"], 500_000.0),
    )

    def __init__(self, mission: Sequence[MissionItem], *, fly: bool = True, **settings: Any) -> None:
        if fly and not mission:
            raise refused("the mission has no items to fly: give another one")
        super().__init__(mission, **settings)
        self._mission = tuple(mission)
        self._upload = MissionUpload(self._link)
        self._fly = fly
        self._must_land = fly and not self._progress.lands_by_itself
        self._preflight_since_ns = 0
        self._handlers |= {
            MSGID["MISSION_REQUEST_INT"]: lambda m: self._upload.on_request(self._t_ns, m),
            MSGID["MISSION_REQUEST"]: lambda m: self._upload.on_request(self._t_ns, m),
            MSGID["MISSION_ACK"]: self._upload.on_ack,
            MSGID["MISSION_CURRENT"]: self._progress.on_mission_current,
            MSGID["MISSION_ITEM_REACHED"]: self._progress.on_item_reached,
        }

    @property
    def waypoints(self) -> int:
        """Number of navigation items with a place."""
        return self._progress.waypoints

    @property
    def reached(self) -> int:
        """Number of these items that the vehicle has reported as reached."""
        return self._progress.reached

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`. Return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        if not self._link.dispatch(frames, self._handlers) and t_ns < self._due_ns:
            return b""
        self._decide(t_ns)
        self._upload.step(t_ns)
        self._decide_by(self._upload.due_ns)
        return self._link.take()

    def _connecting(self, t_ns: int) -> None:
        if not self._connected(t_ns):
            return
        if self._fly:
            autopilot = self._heartbeats.autopilot
            firmware = self._heartbeats.firmware
            self._progress.first_seq = firmware.first_mission_item
            self._upload.start(t_ns, items_for(autopilot, self._mission), retry_refusals=firmware.fails_until_ready)
            self._enter(Phase.UPLOADING, t_ns)
        else:
            self._enter(Phase.ARMING, t_ns)

    def _uploading(self, t_ns: int) -> None:
        if self._upload.done:
            self._preflight_since_ns = t_ns
            self._enter(Phase.PREFLIGHT, t_ns)

    def _preflight(self, t_ns: int) -> None:
        if self._progress.current > 0 and self._heartbeats.firmware.resumes_missions:
            self._go_to_first_item(t_ns)
        elif self._health.ready(t_ns) and self.may_arm():
            self._enter(Phase.ARMING, t_ns)
            steps = start_steps(self._heartbeats.autopilot, self._heartbeats.vehicle_type)
            self._requests.begin(self._preflight_since_ns, steps, self._preflight_limit_ns)
        else:
            self._check_preflight(t_ns, self._preflight_since_ns, self._health.problem())

    def _go_to_first_item(self, t_ns: int) -> None:
        """Set the current item: PX4 resumes a mission that it already holds where an earlier flight ended."""
        self._check_preflight(t_ns, self._preflight_since_ns, "it does not go back to the first item of the mission")
        if self._retry_ns is None or t_ns >= self._retry_ns:
            link = self._link
            link.send(_MissionSetCurrent(link.target_sysid, link.target_compid, self._progress.first_seq))
            self._retry_ns = t_ns + NS_PER_S

    def _arming(self, t_ns: int) -> None:
        if not self._requests.step(t_ns):
            return
        if self._heartbeats.armed:
            self._enter(Phase.FLYING, t_ns)
        elif self._fly and t_ns - self._preflight_since_ns >= self._preflight_limit_ns:
            raise refused(f"the vehicle accepted the mission, but did not arm{self._texts.last(6)}")

    def _flying(self, t_ns: int) -> None:
        progress = self._progress
        if not progress.flown:
            if not self._fly:
                if not self._heartbeats.armed:
                    self._enter(Phase.ARMING, t_ns)
                return
            if not self._heartbeats.armed and self._texts.said(_ABORTED):
                self._land_reached(t_ns)  # the vehicle failed, on the ground, and not the bench
                return
            self._check_takeoff(t_ns)
            if not self._heartbeats.armed:
                raise refused(f"the vehicle disarmed before it took off{self._texts.last()}")
            return
        if progress.on_ground and not self._heartbeats.armed:
            progress.on_landed()
            self._land_reached(t_ns)
        elif self._must_land and progress.completed and not self._commands.busy:
            self._must_land = False
            beat = self._heartbeats
            self._commands.send(t_ns, _DO_SET_MODE, mode_params(beat.autopilot, "LAND", beat.vehicle_type))
