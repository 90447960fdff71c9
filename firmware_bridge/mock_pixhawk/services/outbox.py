"""Queue of the autopilot's outgoing messages."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.mock_pixhawk.faults import FaultInjector
from firmware_bridge.mock_pixhawk.ids import Severity

HIL_ACTUATOR_CONTROLS = MSGID["HIL_ACTUATOR_CONTROLS"]
CHANNELS = 16  # its control slots
_pack_actuators = struct.Struct("<QQ16fB").pack
_Text = message_class("STATUSTEXT")
_TEXT_LENGTH = 50
LIMIT = 1000  # messages kept while nothing may be written, as the buffer of a port is limited too


class Outbox:
    """Messages in order. While `holding`, nothing is taken out and the oldest beyond `LIMIT` are dropped."""

    def __init__(self, encoder: FrameEncoder) -> None:
        self.waiting: list[bytes] = []
        # Encodes the next frame: it has a sequence number, so the caller must write it.
        self.frame = encoder.frame
        # Appends bytes that must not be dropped: a reply to the bench.
        self.push = self.waiting.append
        self._text_id = 0
        self.holding = True
        self.dropped = 0

    def send_payload(self, msgid: int, payload: bytes) -> None:
        """Append a message with a packed payload."""
        if self.holding and len(self.waiting) >= LIMIT:
            del self.waiting[0]
            self.dropped += 1
        self.waiting.append(self.frame(msgid, payload))

    def send(self, message: Any) -> None:
        """Append a message."""
        self.send_payload(message.MSGID, pack(message))

    def take(self) -> bytes:
        """Return all waiting bytes and empty the queue."""
        out = b"".join(self.waiting)
        self.waiting.clear()
        return out

    # -- STATUSTEXT ---------------------------------------------------------------------------------------------

    def say(self, severity: int, text: str) -> None:
        """Append a STATUSTEXT, in chunks of 50 characters if it is longer. Characters outside ASCII become '?'."""
        text = text.encode("ascii", "replace").decode("ascii")
        if len(text) <= _TEXT_LENGTH:
            self.send(_Text(severity, text))
            return
        self._text_id = self._text_id % 65535 + 1
        for chunk, at in enumerate(range(0, len(text), _TEXT_LENGTH)):
            self.send(_Text(severity, text[at : at + _TEXT_LENGTH], self._text_id, chunk))

    def warn(self, text: str) -> None:
        """Append a STATUSTEXT of severity WARNING."""
        self.say(Severity.WARNING, text)


def push_controls(
    outbox: Outbox, fault_injector: FaultInjector, now_us: int, flags: int, controls: Sequence[float], mode: int
) -> None:
    """Append HIL_ACTUATOR_CONTROLS of this instant, changed by the injected faults. Raises `faults.Died`."""
    faulty = now_us >= fault_injector.earliest_us
    t_us = fault_injector.reply_time_us(now_us) if faulty else now_us
    frame = outbox.frame(HIL_ACTUATOR_CONTROLS, _pack_actuators(t_us, flags, *controls, mode))
    if faulty:
        frame = fault_injector.output(now_us, outbox.take(), frame)
    outbox.push(frame)
