"""Where clients on the loopback are heard and get their frames: plain TCP connections, one for each sensor's port.

ZeroMQ copies a message into a thread of its own, and from there to a thread of the other process's, which on the
loopback takes longer than the transfer does. It stays the way in, for its handshake, its limits and its word of who has
gone; a client that it has let in connects here as well and says the word it was told with its welcome. From then on its
messages go this way: arrays straight from where they lie into the kernel, nothing put together before.

A message is 12 bytes, how long its header and its body are (u32 and u64, little-endian), then these two. Only frames
have a body. Nothing here is encrypted, so there are streams only where there are no keys, which is on the loopback.

What the kernel does not take at once is copied, and goes when it has room again. What waits unread is bounded by the
kernel's buffers.
"""

from __future__ import annotations

import socket
import struct
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from firmware_bridge.companion.newcomers import Newcomers, Way
from firmware_bridge.companion.unreachable import Unreachable
from hil.signals.errors import PortNotFound

LENGTHS = struct.Struct("<IQ")  # bytes of the header, bytes of the body
_HEADER_BYTES = 64 << 10  # of a client
_UNSENT_BYTES = 256 << 20  # more than that is not taken; one frame always is
_PIECES = 512  # in one system call; the kernel takes 1024


class Stream:
    """One client's connection, for one sensor or for all. Never waits."""

    def __init__(self, wire: socket.socket) -> None:
        self._wire = wire
        wire.setblocking(False)
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._room = bytearray(LENGTHS.size + _HEADER_BYTES)
        self._view = memoryview(self._room)
        self._begin = self._end = 0  # of what was received and not read yet
        self._unsent: deque[memoryview] = deque()
        self.unsent_bytes = 0

    def fileno(self) -> int:
        return self._wire.fileno()

    def send(self, message: bytes) -> bool:
        """Whether there was room. Unreachable if the client has gone."""
        return self.send_frame(message, (), 0)

    def send_frame(self, header: bytes, body: Sequence[bytes | memoryview], body_bytes: int) -> bool:
        """The body in pieces, of so many bytes in all. Whether there was room. Unreachable if the client has gone."""
        size = LENGTHS.size + len(header) + body_bytes
        pieces = [LENGTHS.pack(len(header), body_bytes), header, *body]
        if not self._unsent:
            sent = self._push(pieces)
            if sent < size:
                self._keep(pieces, sent)
            return True
        if self.unsent_bytes + size > _UNSENT_BYTES:
            return False
        self._keep(pieces, 0)
        self.flush()
        return True

    def _push(self, pieces: Sequence[bytes | memoryview]) -> int:
        """How many bytes the kernel took."""
        sent = 0
        try:
            for at in range(0, len(pieces), _PIECES):
                some = pieces[at : at + _PIECES]
                taken = self._wire.sendmsg(some, (), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
                sent += taken
                if len(pieces) > _PIECES and taken < sum(map(len, some)):
                    break
        except BlockingIOError:
            pass
        except OSError as error:
            raise Unreachable from error
        return sent

    def _keep(self, pieces: Sequence[bytes | memoryview], sent: int) -> None:
        """A copy of what is behind the first `sent` bytes."""
        rest = bytearray()
        for piece in pieces:
            rest += piece[sent:] if sent < len(piece) else b""
            sent = max(0, sent - len(piece))
        self._unsent.append(memoryview(rest))
        self.unsent_bytes += len(rest)

    def flush(self) -> None:
        """What the kernel takes now of what it did not take before. Unreachable if the client has gone."""
        while self._unsent:
            first = self._unsent.popleft()
            sent = self._push([first])
            self.unsent_bytes -= sent
            if sent < len(first):
                self._unsent.appendleft(first[sent:])
                return

    def receive(self) -> memoryview | None:
        """The next message, good until the next call; None while there is none. Unreachable once it has ended, or has
        sent what is no message: behind that, nothing is where it should be."""
        message = self._next()
        if message is None:
            try:
                size = self._wire.recv_into(self._view[self._end :], 0, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            except OSError as error:
                raise Unreachable from error
            if size == 0:
                raise Unreachable
            self._end += size
            message = self._next()
        return message

    def _next(self) -> memoryview | None:
        """The first whole message in the room; without one, what there is of it is moved to the room's beginning."""
        there = self._end - self._begin
        if there >= LENGTHS.size:
            length, body_bytes = LENGTHS.unpack_from(self._room, self._begin)
            if length > _HEADER_BYTES or body_bytes:
                raise Unreachable(f"it sent what is no message ({length} and {body_bytes} bytes)")
            if there >= LENGTHS.size + length:
                begin = self._begin + LENGTHS.size
                self._begin = begin + length
                return self._view[begin : self._begin]
        if self._begin:
            self._room[:there] = self._room[self._begin : self._end]
            self._begin, self._end = 0, there
        return None

    def close(self) -> None:
        """What was said before can still be received there."""
        with suppress(Unreachable):
            self.flush()
        with suppress(OSError):
            self._wire.shutdown(socket.SHUT_WR)
            while self._wire.recv_into(self._room, 0, socket.MSG_DONTWAIT):
                pass  # with something unread here, the kernel would reset the connection and throw ours away
        self._wire.close()


class Streams:
    """The listening socket of one port's streams, on any free port of the host."""

    def __init__(self, host: str) -> None:
        """PortNotFound."""
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._wire = socket.create_server((host, 0), family=family, backlog=16)
        except OSError as error:
            raise PortNotFound(f"tcp://{host}", f"cannot be listened on ({error.strerror or error})") from error
        self._wire.setblocking(False)
        self.address = (host, int(self._wire.getsockname()[1]))
        self._newcomers = Newcomers(self._wire, Stream)

    def fileno(self) -> int:
        return self._wire.fileno()

    def serve(self, welcome: Callable[[bytes, Way], bool]) -> None:
        """Let in who says a word that `welcome` knows; the others are sent away."""
        self._newcomers.serve(welcome)

    def close(self) -> None:
        """May be called twice."""
        self._newcomers.close()
        self._wire.close()
