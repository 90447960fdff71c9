"""The wire between a run and its page: one stream socket, messages with their length before them.

A run must never wait for whoever looks at it. So the run's side is non-blocking both ways, and it has at most one
update under way: the page asks for the next one when it has taken the last. What happens in between is never queued;
the page gets what is true when it asks.
"""

from __future__ import annotations

import socket
import struct
from typing import Any

import msgpack

_HEAD = struct.Struct("<I")
_READ = 1 << 16
MAX_MESSAGE = 64 << 20  # of one update; nothing on this wire is near it


def packed(message: dict[str, Any]) -> bytes:
    """A message as it goes over the wire."""
    body: bytes = msgpack.packb(message, use_bin_type=True)
    return _HEAD.pack(len(body)) + body


class Unpacker:
    """Bytes in any pieces to messages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """Every message that is complete now. ValueError for what is no message of this wire."""
        self._data += data
        found: list[dict[str, Any]] = []
        while len(self._data) >= _HEAD.size:
            (length,) = _HEAD.unpack_from(self._data)
            if length > MAX_MESSAGE:
                raise ValueError(f"a message of {length} bytes")
            if len(self._data) < _HEAD.size + length:
                break
            body = bytes(self._data[_HEAD.size : _HEAD.size + length])
            del self._data[: _HEAD.size + length]
            message = msgpack.unpackb(body, raw=False)
            if isinstance(message, dict):
                found.append(message)
        return found


class RunEnd:
    """The run's end of the wire. Nothing here waits, but for `wait` itself."""

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
        """What has come."""
        found: list[dict[str, Any]] = []
        while not self.lost:
            try:
                data = self._wire.recv(_READ)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                data = b""
            if not data:
                self.lost = True
                break
            try:
                found += self._unpacker.feed(data)
            except ValueError:
                self.lost = True
            if len(data) < _READ:
                break  # what comes after this is for the next look
        return found

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
