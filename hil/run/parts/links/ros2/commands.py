"""Commands to the vehicle by service or topic: arm, take off, land, set the mode.

    /arm                   std_srvs/SetBool           arms or disarms
    /takeoff, /land        std_srvs/Trigger           to `ros2.takeoff_height_m` above the place; land where it is
    /set_mode              mavros_msgs/SetMode        custom_mode: a word of PX4, ArduPilot or the bench
    topics /cmd_arm, /cmd_takeoff, /cmd_mode          std_msgs/Bool, Empty, String: the same without an answer
    /mavros/cmd/arming, /mavros/cmd/takeoff, /mavros/cmd/land, /mavros/set_mode
                           mavros_msgs/CommandBool, CommandTOL, CommandTOL, SetMode, as MAVROS has them

Arming and modes are the autopilot's commands, and the answer is the autopilot's. A take-off is a position set-point
that is repeated until it is reached; other set-points are dropped meanwhile, so that a controller that sends zeros does
not end it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from firmware_bridge.ground_station.command_requests import CommandRequests
from firmware_bridge.ground_station.modes import WORDS
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from hil.run.live.messages import Names
from hil.run.parts.links.ros2.service import Request, Service
from hil.run.parts.links.ros2.set_points import heading_of
from signals.desired import DesiredState
from signals.documents.validate import nearest
from signals.samples import TruthState

_REACHED_M = 0.2  # below the height of a take-off
_LARGEST_M = 1000.0
_ACCEPTED, _FAILED = 0, 4  # MAV_RESULT, in the replies of mavros_msgs
# Names of modes in MAVROS for PX4 and ArduPilot -> words of the bench
_MODES = {
    "AUTO.MISSION": "MISSION",
    "AUTO.LOITER": "HOLD",
    "AUTO.RTL": "RTL",
    "AUTO.LAND": "LAND",
    "AUTO.TAKEOFF": "TAKEOFF",
    "POSCTL": "POSITION",
    "ALTCTL": "ALTITUDE",
    "BRAKE": "HOLD",
    "POSHOLD": "POSITION",
    "ALT_HOLD": "ALTITUDE",
    "STABILIZE": "STABILIZED",
}
_TOPICS = (
    ("/cmd_arm", "std_msgs/Bool", "arm"),
    ("/cmd_takeoff", "std_msgs/Empty", "take_off"),
    ("/cmd_mode", "std_msgs/String", "set_mode"),
)
_SERVICES = (
    ("/arm", "std_srvs/SetBool", "arm"),
    ("/takeoff", "std_srvs/Trigger", "take_off"),
    ("/land", "std_srvs/Trigger", "land"),
    ("/set_mode", "mavros_msgs/SetMode", "set_mode"),
    ("/mavros/cmd/arming", "mavros_msgs/CommandBool", "arm"),
    ("/mavros/cmd/takeoff", "mavros_msgs/CommandTOL", "take_off"),
    ("/mavros/cmd/land", "mavros_msgs/CommandTOL", "land"),
    ("/mavros/set_mode", "mavros_msgs/SetMode", "set_mode"),
)


class VehicleCommands:
    """The services and topics with commands of one vehicle."""

    def __init__(self, node: Any, names: Names, takeoff_height_m: float, on_refused: Callable[[str], None]) -> None:
        """`on_refused` gets the reasons why commands by topic were not carried out."""
        self._on_refused = on_refused
        self.requested = 0  # commands so far
        self._height_m = takeoff_height_m
        self._services = [(Service(node, names.topic(name), kind), kind, action) for name, kind, action in _SERVICES]
        self._topics = [(node.subscription(names.topic(name), kind), action) for name, kind, action in _TOPICS]
        self.types = {names.topic(name): [kind] for name, kind, _ in _TOPICS}
        self._climb: tuple[DesiredState, float] | None = None  # under way, and the height in W at which it ends
        self.commands = CommandRequests()

    @property
    def climbing(self) -> bool:
        """True while a take-off is under way."""
        return self._climb is not None

    def take(
        self, truth: TruthState, pilot: OffboardPilot, refuse: Callable[[ValueError], None]
    ) -> Iterator[DesiredState]:
        """Carry out what was requested. Return the set-points that follow from it."""
        for service, kind, action in self._services:
            for request in service.take(refuse):
                yield from self._carry_out(action, request.message, truth, pilot, partial(_answer, request, kind))
        for subscription, action in self._topics:
            for message in subscription.take(refuse):
                yield from self._carry_out(action, message, truth, pilot, partial(self._told, subscription.name))
        if self._climb is not None:
            desired, end_m = self._climb
            yield desired
            if truth.p_WB[2] >= end_m or pilot.phase in (Phase.LANDING, Phase.LANDED, Phase.DONE):
                self._climb = None

    @property
    def services(self) -> list[str]:
        """The names of the services."""
        return [service.name for service, _, _ in self._services]

    def _told(self, name: str, why: str) -> None:
        if why:
            self._on_refused(f"{name}: {why}")

    def _carry_out(
        self, action: str, message: Any, truth: TruthState, pilot: OffboardPilot, answer: Callable[[str], None]
    ) -> Iterator[DesiredState]:
        self.requested += 1
        if action == "arm":
            self.commands.arm(bool(getattr(message, "data", False) or getattr(message, "value", False)), answer)
        elif action == "set_mode":
            self._set_mode(getattr(message, "custom_mode", "") or getattr(message, "data", ""), pilot, answer)
        elif action == "land":
            self._climb = None
            is_flying = pilot.phase in (Phase.FLYING, Phase.ARMING)
            answer("" if is_flying else "the vehicle does not fly")
            if is_flying:
                yield DesiredState(land=True)
        else:
            answer(self._take_off(getattr(message, "altitude", 0.0) or self._height_m, truth, pilot))

    def _take_off(self, height_m: float, truth: TruthState, pilot: OffboardPilot) -> str:
        """Begin to climb. Return "", or why not."""
        if not 0.0 < height_m <= _LARGEST_M:
            return f"the height is {height_m:g} m; it goes up to {_LARGEST_M:g} m above the vehicle"
        if not pilot.ready:
            return "the autopilot is not ready to arm yet"
        if pilot.phase not in (Phase.PREFLIGHT, Phase.ARMING, Phase.FLYING):
            return f"the flight is over (phase {pilot.phase.value})"
        x, y, z = truth.p_WB
        end_m = z + height_m
        self._climb = DesiredState(p_W=(x, y, end_m), yaw_rad=heading_of(truth.q_WB)), end_m - _REACHED_M
        return ""

    def _set_mode(self, name: str, pilot: OffboardPilot, answer: Callable[[str], None]) -> None:
        word = _MODES.get(name.upper(), name.upper())
        if word not in WORDS:
            known = (*WORDS, *_MODES)
            answer(f"unknown mode {name!r} ({nearest(name.upper(), known) or 'modes: ' + ', '.join(known)})")
            return
        self._climb = None
        pilot.requested_mode = word
        self.commands.set_mode(word, answer)


def _answer(request: Request, kind: str, why: str) -> None:
    """Answer a request. `why`: "" if it is carried out, otherwise why not."""
    if kind.startswith("std_srvs/"):
        request.reply(success=not why, message=why)
    elif kind == "mavros_msgs/SetMode":
        request.reply(mode_sent=not why)
    else:
        request.reply(success=not why, result=_FAILED if why else _ACCEPTED)
