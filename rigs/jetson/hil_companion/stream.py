"""A plain TCP connection to a bench on this machine that uses no keys: frames in one piece, without ZeroMQ's threads.

A message is 12 bytes, how long its header and its body are (u32 and u64, little-endian), then these two. The header
can be read while the body is still on its way: `receive` gives both, `finish` waits for the rest.
"""

from __future__ import annotations

import select
import socket
import struct
import time

import numpy as np

from hil_companion.errors import ConnectionLost
from hil_companion.patience import Patience
from hil_companion.protocol import MAX_HEADER_BYTES

LENGTHS = struct.Struct("<IQ")
READ_BYTES = 8 << 10  # at once while a header is due: what of it is a body's is copied
WAIT_S = 5.0  # for the connection, and for the rest of a frame while nothing of it comes


class Stream:
    """Connected, and the word said."""

    def __init__(self, host: str, port: int, word: str, max_message_bytes: int) -> None:
        """OSError where nobody listens."""
        self.place = f"tcp://{host}:{port}"
        self._max_message_bytes = max_message_bytes
        self._room = memoryview(bytearray(READ_BYTES))
        self._begin = self._end = 0  # of what was received and not read yet
        self._body = memoryview(b"")
        self._filled = 0
        self._patience = Patience()
        self._poller = select.poll()
        self._wire = socket.create_connection((host, port), WAIT_S)
        self._wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._wire.setblocking(False)
        self._poller.register(self._wire, select.POLLIN)
        self.send(word.encode("ascii", "replace"))

    def fileno(self) -> int:
        return self._wire.fileno()

    def send(self, message: bytes) -> None:
        """To a bench that has gone nothing is said; what it said before can still be received, and then the loss."""
        data = LENGTHS.pack(len(message), 0) + message
        try:
            if self._wire.send(data, getattr(socket, "MSG_NOSIGNAL", 0)) < len(data):
                raise BlockingIOError
        except BlockingIOError:
            raise ConnectionLost(f"{self.place}: the bench takes no more messages") from None
        except (BrokenPipeError, ConnectionResetError):
            pass
        except OSError as error:
            raise self._lost(error.strerror) from error

    def receive(self) -> list[memoryview] | None:
        """The next header, good until the next call, and its body, which is not there before `finish`, if it has one;
        None while there is none. ConnectionLost once it has ended, or where it sends what is no message."""
        message = self._next()
        if message is None:
            size = self._read(self._room[self._end :])
            if size == 0:
                return None
            self._end += size
            message = self._next()
        return message

    def _next(self) -> list[memoryview] | None:
        there = self._end - self._begin
        need = LENGTHS.size
        if there >= need:
            length, body_bytes = LENGTHS.unpack_from(self._room, self._begin)
            if length > MAX_HEADER_BYTES or body_bytes > self._max_message_bytes:
                raise self._lost(f"a message of {length} and {body_bytes} bytes")
            need += length
            if there >= need:
                header = self._room[self._begin + LENGTHS.size : self._begin + need]
                self._begin += need
                return [header, *self._begin_body(body_bytes)]
        if self._begin or need > len(self._room):
            room = (
                memoryview(bytearray(max(need, len(self._room)) + READ_BYTES)) if need > len(self._room) else self._room
            )
            room[:there] = bytes(self._room[self._begin : self._end])
            self._room, self._begin, self._end = room, 0, there
        return None

    def _begin_body(self, size: int) -> list[memoryview]:
        """Memory for it, with what of it is here already."""
        if size == 0:
            return []
        self._body = memoryview(np.empty(size, np.uint8))
        self._filled = min(size, self._end - self._begin)
        self._body[: self._filled] = self._room[self._begin : self._begin + self._filled]
        self._begin += self._filled
        return [self._body]

    def finish(self) -> None:
        """Until the whole body is there. ConnectionLost if it ends before, or stands still for seconds."""
        since_s = time.monotonic()
        while self._filled < len(self._body):
            size = self._read(self._body[self._filled :])
            now_s = time.monotonic()
            if size:
                self._filled += size
                self._patience.waited(now_s - since_s)
                since_s = now_s
            elif now_s - since_s > WAIT_S:
                raise self._lost(f"the rest of a frame did not come within {WAIT_S:g} s")
            elif not self._patience.stays_awake(now_s - since_s, begun=True):
                self._poller.poll(1000 * WAIT_S)
        self._body = memoryview(b"")
        self._filled = 0

    def _read(self, room: memoryview) -> int:
        """How many bytes came; 0 for none yet."""
        try:
            size = self._wire.recv_into(room)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._lost(error.strerror) from error
        if size == 0:
            raise self._lost("")
        return size

    def _lost(self, why: str | None) -> ConnectionLost:
        return ConnectionLost(f"{self.place}: the connection was lost" + (f" ({why})" if why else ""))

    def close(self) -> None:
        self._wire.close()
