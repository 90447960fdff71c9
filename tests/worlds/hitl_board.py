"""A board in HITL for tests: the mock on a pseudo-terminal that can be unplugged and plugged in again.

The board's program runs on a thread; its clock is the wall clock.
"""

from __future__ import annotations

import os
import pty
import threading
import tty
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from fastcrc.crc16 import mcrf4xx

from firmware_bridge.codecs.dialect import SHAPES
from firmware_bridge.codecs.mavlink_frame import FrameSplitter, message_id
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.hitl import DEFAULT_BAUD, Board
from firmware_bridge.mock_pixhawk.line import serve
from tests.worlds.patience import PATIENCE_S, until


class Tap:
    """The mock and its input; `mute` names messages that it does not send, or is "all"."""

    def __init__(self, mock: MockPixhawk, mute: Sequence[str]) -> None:
        self.mock = mock
        self.mute = set(mute)
        self.heard: list[int] = []
        self.gone = False
        self.spoil = 0  # number of next commands that hold NaN, with valid checksums
        self._in, self._out = FrameSplitter(), FrameSplitter()

    @property
    def next_due_us(self) -> int | None:
        return self.mock.next_due_us

    def boot(self) -> bytes:
        return self._spoken(self.mock.boot())

    def feed(self, data: bytes) -> bytes:
        if self.gone:
            raise OSError("unplugged")
        self.heard += [message_id(unit) for unit in self._in.feed(data)]
        return self._spoken(self.mock.feed(data))

    def _spoken(self, data: bytes) -> bytes:
        if not self.mute and not self.spoil:
            return data
        if "all" in self.mute:
            return b""
        ids = {MSGID[name] for name in self.mute}
        return b"".join(self._spoilt(unit) for unit in self._out.feed(data) if message_id(unit) not in ids)

    def _spoilt(self, unit: bytes) -> bytes:
        if self.spoil == 0 or message_id(unit) != MSGID["HIL_ACTUATOR_CONTROLS"]:
            return unit
        self.spoil -= 1
        # Ten bytes of header, time_usec and flags, the controls, a checksum.
        body = unit[1:26] + b"\0\0\xc0\x7f" + unit[30:-2]
        return (
            unit[:1]
            + body
            + mcrf4xx(body + bytes((SHAPES[MSGID["HIL_ACTUATOR_CONTROLS"]].crc_extra,))).to_bytes(2, "little")
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self.mock, name)


class HitlBoard:
    """`port` is its serial port."""

    def __init__(self, *, params: Sequence[str] = (), mute: Sequence[str] = (), baud: int = DEFAULT_BAUD) -> None:
        self._near, self._far = pty.openpty()  # the far end stays open when the bench closes its port
        tty.setraw(self._far)
        self.port = os.ttyname(self._far)
        self.mock = MockPixhawk(board=Board(baud=baud), params=params)
        self.tap = Tap(self.mock, mute)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        serve(self.tap, self._near)  # type: ignore[arg-type]

    def wait_for(self, what: Callable[[], bool]) -> bool:
        return bool(until(what))

    def unplug(self) -> None:
        """Hang up for good, as seen by every process that has the port open."""
        self.tap.gone = True
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        for fd in (self._far, self._near):
            if fd >= 0:
                os.close(fd)
        self._far = self._near = -1


@pytest.fixture
def board() -> Iterator[Callable[..., HitlBoard]]:
    """Make boards; all are unplugged at the end of the test."""
    made: list[HitlBoard] = []

    def make(**settings: Any) -> HitlBoard:
        made.append(HitlBoard(**settings))
        return made[-1]

    yield make
    for one in made:
        one.unplug()
