"""The mission protocol: upload, download, clear (https://mavlink.io/en/services/mission.html).

As PX4's `mavlink_mission.cpp`: one transfer at a time, the receiver requests each item by number, repeats it every
250 ms and gives up after 5 s without a new item. The old mission stays valid until the last new item has arrived.
Times are simulated. Fence and rally lists exist and are always empty.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.mock_pixhawk.flight.mission_item import REPERTOIRES, Repertoire, refusal
from firmware_bridge.mock_pixhawk.ids import (
    MISSION_TYPE_ALL,
    MISSION_TYPE_FENCE,
    MISSION_TYPE_MISSION,
    MISSION_TYPE_RALLY,
    MissionResult,
)
from signals.mission import MissionItem

MAX_ITEMS = 2000
RETRY_US = 250_000
TIMEOUT_US = 5_000_000

_Count = message_class("MISSION_COUNT")
_RequestInt = message_class("MISSION_REQUEST_INT")
_ItemInt = message_class("MISSION_ITEM_INT")
_Item = message_class("MISSION_ITEM")
_Ack = message_class("MISSION_ACK")

_DEGE7 = 1e7


class MissionStore:
    """The mission stored in the vehicle, and the transfer in progress.

    `send(message)` queues a message, `warn(text)` a STATUSTEXT; `changed()` is called after the mission was replaced.
    Handlers take the decoded message and the sender.
    """

    def __init__(
        self,
        send: Callable[[Any], None],
        warn: Callable[[str], None],
        changed: Callable[[], None],
        *,
        repertoire: Repertoire = REPERTOIRES[0],
    ) -> None:
        """`repertoire`: the items that it takes."""
        self._repertoire = repertoire
        self._send = send
        self._warn = warn
        self._changed = changed
        self.items: list[MissionItem] = []
        self._incoming: list[MissionItem] | None = None  # upload in progress
        self._expected = 0
        self._partner = (0, 0)
        self._progress_us = 0  # last new item
        self._asked_us = 0  # last request
        self._just_finished: tuple[int, int, int] | None = None  # partner and number of the last item taken
        self._now_us = 0

    @property
    def busy(self) -> bool:
        """True while an upload is in progress."""
        return self._incoming is not None

    def tick(self, now_us: int) -> None:
        """Request the missing item again, or give up. Call it a few times a second."""
        self._now_us = now_us
        if self._incoming is None:
            return
        if now_us - self._progress_us >= TIMEOUT_US:
            self._warn("Operation timeout")
            self._ack(self._partner, MissionResult.OPERATION_CANCELLED)
            self._incoming = None
        elif now_us - self._asked_us >= RETRY_US:
            self._request()

    def _request(self) -> None:
        self._asked_us = self._now_us
        self._send(_RequestInt(*self._partner, seq=len(self._incoming or ()), mission_type=MISSION_TYPE_MISSION))

    def _ack(self, partner: tuple[int, int], result: int, kind: int = MISSION_TYPE_MISSION) -> None:
        self._send(_Ack(*partner, type=result, mission_type=kind))

    def on_count(self, message: Any, sender: tuple[int, int], now_us: int) -> None:
        """Handle MISSION_COUNT: begin an upload."""
        self._now_us = now_us
        kind = message.mission_type
        if kind in (MISSION_TYPE_FENCE, MISSION_TYPE_RALLY):
            self._ack(sender, MissionResult.NO_SPACE if message.count else MissionResult.ACCEPTED, kind)
            return
        if kind != MISSION_TYPE_MISSION:
            self._ack(sender, MissionResult.UNSUPPORTED, kind)
            return
        if self._incoming is not None and sender != self._partner:
            # An upload of another sender is in progress. The same sender may start again.
            self._ack(sender, MissionResult.ERROR)
            return
        if message.count > MAX_ITEMS:
            self._warn(f"Mission rejected: {message.count} items, at most {MAX_ITEMS}")
            self._incoming = None
            self._ack(sender, MissionResult.NO_SPACE)
            return
        self._just_finished = None
        self._partner = sender
        if message.count == 0:
            self._incoming = None
            self._replace([])
            self._ack(sender, MissionResult.ACCEPTED)
            return
        self._incoming = []
        self._expected = message.count
        self._progress_us = now_us
        self._request()

    def on_item_int(self, message: Any, sender: tuple[int, int], now_us: int) -> None:
        """Handle MISSION_ITEM_INT: one item of an upload."""
        m = message
        item = MissionItem(
            m.seq, m.frame, m.command, m.current, m.autocontinue, m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z
        )
        self._take(item, m.mission_type, sender, now_us)

    def on_item(self, message: Any, sender: tuple[int, int], now_us: int) -> None:
        """Handle MISSION_ITEM: one item of an upload, with floating-point degrees."""
        m = message
        if not (abs(m.x) <= 200.0 and abs(m.y) <= 400.0):  # also NaN
            if self._incoming is not None and sender == self._partner:
                self._incoming = None
                self._ack(sender, MissionResult.INVALID_PARAM5_X)
            return
        x, y = round(m.x * _DEGE7), round(m.y * _DEGE7)
        item = MissionItem(
            m.seq, m.frame, m.command, m.current, m.autocontinue, m.param1, m.param2, m.param3, m.param4, x, y, m.z
        )
        self._take(item, m.mission_type, sender, now_us)

    def _take(self, item: MissionItem, kind: int, sender: tuple[int, int], now_us: int) -> None:
        self._now_us = now_us
        if kind != MISSION_TYPE_MISSION:
            self._ack(sender, MissionResult.ERROR, kind)
            return
        if self._incoming is None or sender != self._partner:
            if self._just_finished == (*sender, item.seq):
                # The acknowledgement was lost or overtaken: send it again.
                self._ack(sender, MissionResult.ACCEPTED)
            else:
                self._ack(sender, MissionResult.ERROR)
            return
        if item.seq != len(self._incoming):
            # A duplicate is ignored. A later item means that one was lost: request the lost one again.
            if item.seq > len(self._incoming):
                self._request()
            return
        result, why = refusal(item, self._expected, self._repertoire)
        if result != MissionResult.ACCEPTED:
            self._incoming = None
            self._warn(f"Mission rejected: item {item.seq}: {why}")
            self._ack(sender, result)
            return
        self._incoming.append(item)
        self._progress_us = now_us
        if len(self._incoming) < self._expected:
            self._request()
            return
        items, self._incoming = self._incoming, None
        self._just_finished = (*sender, item.seq)
        self._replace(items)
        self._ack(sender, MissionResult.ACCEPTED)

    def _replace(self, items: list[MissionItem]) -> None:
        self.items = items
        self._changed()

    def on_request_list(self, message: Any, sender: tuple[int, int]) -> None:
        """Handle MISSION_REQUEST_LIST: send the number of items."""
        kind = message.mission_type
        if kind in (MISSION_TYPE_MISSION, MISSION_TYPE_FENCE, MISSION_TYPE_RALLY):
            count = len(self.items) if kind == MISSION_TYPE_MISSION else 0
            self._send(_Count(*sender, count=count, mission_type=kind))
        else:
            self._ack(sender, MissionResult.UNSUPPORTED, kind)

    def on_request(self, message: Any, sender: tuple[int, int], *, as_int: bool) -> None:
        """Handle MISSION_REQUEST_INT or MISSION_REQUEST: send one item of a download."""
        kind = message.mission_type
        if kind != MISSION_TYPE_MISSION or message.seq >= len(self.items):
            self._ack(sender, MissionResult.INVALID_SEQUENCE, kind)
            return
        i = self.items[message.seq]
        position = (i.lat_degE7, i.lon_degE7) if as_int else (i.lat_degE7 / _DEGE7, i.lon_degE7 / _DEGE7)
        cls = _ItemInt if as_int else _Item
        params = (i.param1, i.param2, i.param3, i.param4)
        head = (*sender, i.seq, i.frame, i.command, i.current, i.autocontinue)
        self._send(cls(*head, *params, *position, i.alt_m, mission_type=kind))

    def on_ack(self, sender: tuple[int, int]) -> None:
        """Handle MISSION_ACK: it ends a download, or cancels the sender's own upload."""
        if self._incoming is not None and sender == self._partner:
            self._incoming = None

    def on_clear(self, message: Any, sender: tuple[int, int]) -> None:
        """Handle MISSION_CLEAR_ALL."""
        kind = message.mission_type
        if kind in (MISSION_TYPE_MISSION, MISSION_TYPE_ALL):
            self._incoming = None
            self._just_finished = None
            self._replace([])
        known = (MISSION_TYPE_MISSION, MISSION_TYPE_FENCE, MISSION_TYPE_RALLY, MISSION_TYPE_ALL)
        self._ack(sender, MissionResult.ACCEPTED if kind in known else MissionResult.UNSUPPORTED, kind)
