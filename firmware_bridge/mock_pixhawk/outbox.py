"""What the autopilot has to say and has not written yet."""

from __future__ import annotations

from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.mock_pixhawk.ids import Severity

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

    def say(self, severity: Severity, text: str) -> None:
        """STATUSTEXT, in chunks of 50 characters where it is longer. The field holds bytes: other than ASCII is '?'."""
        text = text.encode("ascii", "replace").decode("ascii")
        if len(text) <= _TEXT_LENGTH:
            self.send(_Text(int(severity), text))
            return
        self._text_id = self._text_id % 65535 + 1
        for chunk, at in enumerate(range(0, len(text), _TEXT_LENGTH)):
            self.send(_Text(int(severity), text[at : at + _TEXT_LENGTH], self._text_id, chunk))

    def warn(self, text: str) -> None:
        """STATUSTEXT of severity WARNING."""
        self.say(Severity.WARNING, text)
