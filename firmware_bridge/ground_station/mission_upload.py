"""The mission protocol's upload (https://mavlink.io/en/services/mission.html): the vehicle pulls item by item."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.wire import Wire, enum_name, refused
from hil.signals.mission import MissionItem
from hil.signals.time import NS_PER_S

_MissionCount = message_class("MISSION_COUNT")
_MissionItemInt = message_class("MISSION_ITEM_INT")

MAX_COUNT = 65535  # MISSION_COUNT.count is 16 bits wide
_ACCEPTED = 0
_MISSION_TYPE_MISSION = 0
_ANSWER_LIMIT_NS = NS_PER_S
_TRIES = 5
_PATIENT_REFUSALS = 20

# What a person can do about the refusals that happen.
_HINTS = {
    "MAV_MISSION_NO_SPACE": "the autopilot has no room for that many items: shorten the mission",
    "MAV_MISSION_UNSUPPORTED": "it does not know one of the commands",
    "MAV_MISSION_UNSUPPORTED_FRAME": "it does not know the coordinate frame of an item",
    "MAV_MISSION_INVALID_PARAM7": "an altitude is out of range",
}


class MissionUpload:
    """Uploads a mission; `done` once the vehicle has acknowledged them all."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._items: Sequence[MissionItem] = ()
        self._tries = 0
        self._asked = 0  # how many items the vehicle has pulled
        self._unconfirmed = 0  # uploads of which the end was not acknowledged
        self._refusals_left = 0  # that may yet be because the vehicle has not finished starting
        self.due_ns: int | None = None
        self.done = False

    def start(self, t_ns: int, items: Sequence[MissionItem], *, patient: bool) -> None:
        """Offer `items`. HandshakeError if they are too many for the protocol.

        `patient`: a refusal at once is asked about again for a while. ArduPilot has no room until it has started.
        """
        self._refusals_left = _PATIENT_REFUSALS if patient else 0
        self._items = items
        if len(self._items) > MAX_COUNT:
            raise refused(f"a mission of {len(self._items)} items: MAVLink can carry {MAX_COUNT}; shorten it")
        self._offer(t_ns)

    def _offer(self, t_ns: int) -> None:
        wire = self._wire
        wire.say(_MissionCount(wire.target_sysid, wire.target_compid, len(self._items), _MISSION_TYPE_MISSION))
        self._tries += 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_request(self, t_ns: int, message: Any) -> None:
        """MISSION_REQUEST_INT or MISSION_REQUEST: give that item, as often as it is asked for."""
        if self.due_ns is None or message.mission_type != _MISSION_TYPE_MISSION or not self._wire.for_us(message):
            return
        if message.seq >= len(self._items):
            raise refused(f"mission upload: item {message.seq} was asked for, but there are {len(self._items)}")
        item = self._items[message.seq]
        wire = self._wire
        wire.say(
            _MissionItemInt(
                wire.target_sysid,
                wire.target_compid,
                message.seq,
                item.frame,
                item.command,
                item.current,
                item.autocontinue,
                item.param1,
                item.param2,
                item.param3,
                item.param4,
                item.lat_degE7,
                item.lon_degE7,
                item.alt_m,
                _MISSION_TYPE_MISSION,
            )
        )
        self._asked = max(self._asked, message.seq + 1)
        self._tries = 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_ack(self, message: Any) -> None:
        if self.due_ns is None or message.mission_type != _MISSION_TYPE_MISSION or not self._wire.for_us(message):
            return
        if message.type != _ACCEPTED and not self._asked and self._refusals_left:
            self._refusals_left -= 1
            self._tries = 0
            return  # offered anew when the answer is overdue
        if message.type != _ACCEPTED:
            result = enum_name("MAV_MISSION_RESULT", message.type)
            hint = _HINTS.get(result, "see the autopilot's messages")
            last = self._items[self._asked - 1] if self._asked else None
            if last is not None:
                hint += f" (last asked for: item {last.seq}, command {last.command}, frame {last.frame})"
            raise refused(
                f"the mission of {len(self._items)} items was refused after {self._asked} of them: {result}; {hint}"
            )
        if self._asked < len(self._items):
            raise refused(f"the mission was accepted after {self._asked} of {len(self._items)} items")
        self.done = True
        self.due_ns = None

    def step(self, t_ns: int) -> None:
        """Offer the mission again if the vehicle has stopped pulling.

        HandshakeError when that has not helped.
        """
        if self.due_ns is None or t_ns < self.due_ns:
            return
        if self._tries >= _TRIES or self._unconfirmed >= _TRIES:
            raise refused(
                f"mission upload: {self._asked} of {len(self._items)} items were asked for, then nothing for "
                f"{_TRIES} s of simulated time; is the autopilot's mission service running?"
            )
        if self._asked == len(self._items):
            # It has them all, or asks again for the last one by itself; so the acknowledgement was lost.
            self._unconfirmed += 1
            self._offer(t_ns)
        elif self._asked:
            # The vehicle asks again for a lost item by itself; offering anew would start over.
            self._tries += 1
            self.due_ns = t_ns + _ANSWER_LIMIT_NS
        else:
            self._offer(t_ns)
