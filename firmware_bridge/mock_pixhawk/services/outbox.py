"""What the autopilot has to say and has not written yet."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.mock_pixhawk.faults import Misbehaviour
from firmware_bridge.mock_pixhawk.ids import Severity

HIL_ACTUATOR_CONTROLS = MSGID["HIL_ACTUATOR_CONTROLS"]
CHANNELS = 16  # its control slots
_pack_actuators = struct.Struct("<QQ16fB").pack
_Text = message_class("STATUSTEXT")
_TEXT_LENGTH = 50
LIMIT = 1000  # messages that wait while nothing may be written: a port's buffer is not endless either


class Outbox:
    """Messages in order. While `holding` nothing is taken out, and of more than `LIMIT` the oldest are dropped."""

    def __init__(self, encoder: FrameEncoder) -> None:
        self._encoder = encoder
        self._waiting: list[bytes] = []
        self._text_id = 0
        self.holding = True
        self.dropped = 0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def frame(self, msgid: int, payload: bytes) -> bytes:
        """The next frame; whoever has it made must see to it that it is written."""
        return self._encoder.frame(msgid, payload)

    def push(self, data: bytes) -> None:
        """Append bytes that must not be dropped: an answer to the bench."""
        self._waiting.append(data)

    def send_payload(self, msgid: int, payload: bytes) -> None:
        """Append a message whose payload is packed already."""
        if self.holding and len(self._waiting) >= LIMIT:
            del self._waiting[0]
            self.dropped += 1
        self._waiting.append(self._encoder.frame(msgid, payload))

    def send(self, message: Any) -> None:
        """Append a message."""
        self.send_payload(message.MSGID, pack(message))

    def take(self) -> bytes:
        """All of it, which is then gone from here."""
        out = b"".join(self._waiting)
        self._waiting.clear()
        return out

    # -- STATUSTEXT ---------------------------------------------------------------------------------------------

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT, in chunks of 50 characters where it is longer. The field holds bytes: other than ASCII is '?'."""
        text = text.encode("ascii", "replace").decode("ascii")
        if len(text) <= _TEXT_LENGTH:
            self.send(_Text(severity, text))
            return
        self._text_id = self._text_id % 65535 + 1
        for chunk, at in enumerate(range(0, len(text), _TEXT_LENGTH)):
            self.send(_Text(severity, text[at : at + _TEXT_LENGTH], self._text_id, chunk))

    def warn(self, text: str) -> None:
        """STATUSTEXT of severity WARNING."""
        self.say(Severity.WARNING, text)


def push_controls(
    outbox: Outbox, misbehaviour: Misbehaviour, now_us: int, flags: int, controls: Sequence[float], mode: int
) -> None:
    """HIL_ACTUATOR_CONTROLS of this instant, or what the injected faults make of it. Raises `faults.Died`."""
    misbehaving = now_us >= misbehaviour.earliest_us
    t_us = misbehaviour.reply_time_us(now_us) if misbehaving else now_us
    frame = outbox.frame(HIL_ACTUATOR_CONTROLS, _pack_actuators(t_us, flags, *controls, mode))
    if misbehaving:
        frame = misbehaviour.output(now_us, outbox.take(), frame)
    outbox.push(frame)
