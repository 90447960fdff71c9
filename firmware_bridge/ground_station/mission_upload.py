"""Uploads a mission (https://mavlink.io/en/services/mission.html): the vehicle requests item by item."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name, refused
from signals.mission import MissionItem
from signals.time import NS_PER_S

_MissionCount = message_class("MISSION_COUNT")
_MissionItemInt = message_class("MISSION_ITEM_INT")

MAX_COUNT = 65535  # MISSION_COUNT.count is 16 bits wide
_ACCEPTED = 0
_MISSION_TYPE_MISSION = 0
_ANSWER_LIMIT_NS = NS_PER_S
_TRIES = 5
_RETRIED_REFUSALS = 20

# Remedies for common refusals.
_HINTS = {
    "MAV_MISSION_NO_SPACE": "the autopilot cannot store that many items: shorten the mission",
    "MAV_MISSION_UNSUPPORTED": "it does not support one of the commands: remove it",
    "MAV_MISSION_UNSUPPORTED_FRAME": "it does not support the coordinate frame of an item: use another",
    "MAV_MISSION_INVALID_PARAM7": "an altitude is out of range: correct it",
}


class MissionUpload:
    """Uploads a mission; `done` once the vehicle has acknowledged all items."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link
        self._items: Sequence[MissionItem] = ()
        self._tries = 0
        self._requested = 0  # items that the vehicle has requested
        self._unconfirmed = 0  # complete uploads without an acknowledgement
        self._refusals_left = 0  # retries while the vehicle may still be starting
        self.due_ns: int | None = None
        self.done = False

    def start(self, t_ns: int, items: Sequence[MissionItem], *, retry_refusals: bool) -> None:
        """Offer `items`. HandshakeError if they are too many for the protocol.

        `retry_refusals`: repeat the offer for a while after an immediate refusal. ArduPilot refuses until it has
        started.
        """
        self._refusals_left = _RETRIED_REFUSALS if retry_refusals else 0
        self._items = items
        if len(self._items) > MAX_COUNT:
            raise refused(f"the mission has {len(self._items)} items, but MAVLink can carry {MAX_COUNT}; shorten it")
        self._offer(t_ns)

    def _offer(self, t_ns: int) -> None:
        link = self._link
        link.send(_MissionCount(link.target_sysid, link.target_compid, len(self._items), _MISSION_TYPE_MISSION))
        self._tries += 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_request(self, t_ns: int, message: Any) -> None:
        """Send the item that MISSION_REQUEST_INT or MISSION_REQUEST asks for."""
        if self.due_ns is None or message.mission_type != _MISSION_TYPE_MISSION or not self._link.is_for_us(message):
            return
        if message.seq >= len(self._items):
            raise refused(
                f"mission upload: the vehicle requested item {message.seq} of {len(self._items)}; does another ground "
                "station upload, too?"
            )
        item = self._items[message.seq]
        link = self._link
        link.send(
            _MissionItemInt(
                link.target_sysid,
                link.target_compid,
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
        self._requested = max(self._requested, message.seq + 1)
        self._tries = 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_ack(self, message: Any) -> None:
        if self.due_ns is None or message.mission_type != _MISSION_TYPE_MISSION or not self._link.is_for_us(message):
            return
        if message.type != _ACCEPTED and not self._requested and self._refusals_left:
            self._refusals_left -= 1
            self._tries = 0
            return  # the offer is repeated when the answer is overdue
        if message.type != _ACCEPTED:
            result = enum_name("MAV_MISSION_RESULT", message.type)
            hint = _HINTS.get(result, "see the autopilot's messages")
            last = self._items[self._requested - 1] if self._requested else None
            if last is not None:
                hint += f" (last requested: item {last.seq}, command {last.command}, frame {last.frame})"
            raise refused(
                f"the mission of {len(self._items)} items was refused after {self._requested} of them: {result}; {hint}"
            )
        if self._requested < len(self._items):
            raise refused(
                f"the vehicle accepted the mission after {self._requested} of {len(self._items)} items; does "
                "another ground station upload, too?"
            )
        self.done = True
        self.due_ns = None

    def step(self, t_ns: int) -> None:
        """Offer the mission again if the vehicle has stopped requesting items. HandshakeError after the last try."""
        if self.due_ns is None or t_ns < self.due_ns:
            return
        if self._tries >= _TRIES or self._unconfirmed >= _TRIES:
            raise refused(
                f"mission upload: {self._requested} of {len(self._items)} items were requested, then none for "
                f"{_TRIES} s of simulated time; is the autopilot's mission service running?"
            )
        if self._requested == len(self._items):
            # The vehicle has all items (it would request a missing one again), so its acknowledgement was lost.
            self._unconfirmed += 1
            self._offer(t_ns)
        elif self._requested:
            # The vehicle requests a lost item again by itself; a new offer would start over.
            self._tries += 1
            self.due_ns = t_ns + _ANSWER_LIMIT_NS
        else:
            self._offer(t_ns)
