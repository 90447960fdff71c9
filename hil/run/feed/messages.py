"""Message formats: msgpack between a run and the page's server, JSON and binary payloads between the server and a page.

A run must never wait for a page. The run's reads and writes are therefore non-blocking, and at most one update is under
way: the page requests the next one when it has received the last. Updates are not queued; an update has the values at
the time of its request.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeGuard

import msgpack

from hil.run.report.run_json import finite

UINT32 = struct.Struct("<I")
MAX_MESSAGE = 64 << 20  # bytes; updates are much smaller


class StreamFrame(NamedTuple):
    """The newest frame of one stream, encoded for a page. `head` describes the bytes in `data`."""

    head: dict[str, Any]
    data: bytes


def packed(message: dict[str, Any]) -> bytes:
    """Encode a message between a run and the page's server. Text that UTF-8 cannot express gets question marks."""
    data: bytes = msgpack.packb(message, unicode_errors="replace")
    return data


class Unpacker:
    """Decodes messages from bytes that arrive in pieces of any size."""

    def __init__(self) -> None:
        self._stream = msgpack.Unpacker(max_buffer_size=MAX_MESSAGE)

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """Return every message that is complete now. Raises ValueError for bytes that are not msgpack."""
        try:
            self._stream.feed(data)
            return [message for message in self._stream if isinstance(message, dict)]
        except msgpack.exceptions.BufferFull as error:
            raise ValueError(f"a message of more than {MAX_MESSAGE} bytes") from error


def packed_update(head: Mapping[str, Any], frames: Iterable[StreamFrame]) -> bytes:
    """Encode one update for a page: uint32 length of the head, the head in JSON, then the payloads of the frames.

    The payloads have the order of the head's `frames`, whose `length` is in bytes.
    """
    frames = list(frames)
    full_head = dict(head) | {"frames": [frame.head | {"length": len(frame.data)} for frame in frames]}
    text = json.dumps(finite(full_head), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(text) + UINT32.size) % 4)  # aligns the floats that follow
    return UINT32.pack(len(text)) + text + b"".join(frame.data for frame in frames)


def is_number(value: Any) -> TypeGuard[int | float]:
    """Return True if a value that a page sent is a finite number; booleans are not numbers here."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
