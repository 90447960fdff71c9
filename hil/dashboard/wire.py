"""The dashboard's two wires: msgpack between a run and the page's server, JSON and bytes between the server and a page.

A run must never wait for whoever looks at it. So the run's side is non-blocking both ways, and it has at most one
update under way: the page asks for the next one when it has taken the last. What happens in between is never queued;
the page gets what is true when it asks.
"""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeGuard

import msgpack

from hil.report.run_json import finite

if TYPE_CHECKING:
    from hil.dashboard.pictures import Shown

UINT32 = struct.Struct("<I")
_READ = 1 << 16
MAX_MESSAGE = 64 << 20  # of one update; nothing on this wire is near it


def packed(message: dict[str, Any]) -> bytes:
    """A message as it goes between a run and the page's server."""
    data: bytes = msgpack.packb(message)
    return data


class Unpacker:
    """Bytes in any pieces to messages."""

    def __init__(self) -> None:
        self._stream = msgpack.Unpacker(max_buffer_size=MAX_MESSAGE)

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """Every message that is complete now. ValueError for what is no message of this wire."""
        try:
            self._stream.feed(data)
            return [message for message in self._stream if isinstance(message, dict)]
        except msgpack.exceptions.BufferFull as error:
            raise ValueError(f"a message of more than {MAX_MESSAGE} bytes") from error


def packed_update(head: Mapping[str, Any], frames: Iterable[Shown]) -> bytes:
    """What goes to a page in one message: uint32 length of the head, the head in JSON, the streams that it announces.

    Their bodies are one behind the other in the order of the head's `frames`, each of `length` bytes.
    """
    shown = list(frames)
    whole = dict(head) | {"frames": [one.head | {"length": len(one.data)} for one in shown]}
    text = json.dumps(finite(whole), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(text) + UINT32.size) % 4)  # so that floats in what follows are aligned
    return UINT32.pack(len(text)) + text + b"".join(one.data for one in shown)


def is_number(value: Any) -> TypeGuard[int | float]:
    """Whether a value that a page sent is a finite number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


class RunEnd:
    """The run's end of the wire. Nothing here waits, but for `write_last`."""

    def __init__(self, wire: socket.socket) -> None:
        self.lost = False  # the page's server is gone; the run goes on without it
        self._wire = wire
        self._wire.setblocking(False)
        self._unpacker = Unpacker()
        self._waiting = memoryview(b"")

    @property
    def busy(self) -> bool:
        """Whether something is still to be written."""
        return len(self._waiting) > 0

    def read(self) -> list[dict[str, Any]]:
        """What has come; what comes after 64 KiB is for the next look."""
        if self.lost:
            return []
        try:
            data = self._wire.recv(_READ)
            self.lost = not data
            return self._unpacker.feed(data)
        except (BlockingIOError, InterruptedError):
            return []
        except (OSError, ValueError):
            self.lost = True
            return []

    def write(self, message: dict[str, Any]) -> None:
        """Begin to write; call only while not `busy`."""
        self._waiting = memoryview(packed(message))
        self.push()

    def push(self) -> None:
        """Write what goes now."""
        while len(self._waiting) and not self.lost:
            try:
                sent = self._wire.send(self._waiting)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                self.lost = True
                return
            self._waiting = self._waiting[sent:]

    def write_last(self, message: dict[str, Any], limit_s: float) -> None:
        """The run is over: now there is time, but not for ever."""
        self._wire.settimeout(limit_s)
        try:
            self._wire.sendall(bytes(self._waiting) + packed(message))
        except OSError:
            self.lost = True

    def close(self) -> None:
        self._wire.close()
