"""The wires below a bench socket: which connections there are, what each has sent, and cutting one.

ZeroMQ tells neither who has gone nor how much of an unfinished message it holds in memory: a message of a thousand
parts is kept until its last part has come, whatever the limits. The kernel knows both. A duplicate of each accepted
descriptor lets the bench read the connection's byte count and shut it down; `zmq.SRCFD` links messages to it.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass

_BYTES_RECEIVED = struct.Struct("=Q")
_BYTES_RECEIVED_AT = 128  # of struct tcp_info, linux/tcp.h
_CHECK_NS = 10_000_000
_OVERHEAD = 80  # bytes that a part costs at most besides its own: framing, encryption


@dataclass
class _Connection:
    wire: socket.socket
    consumed: int = 0  # bytes that came out of it as whole messages


class Connections:
    """The connections of one bench socket, by the descriptor that ZeroMQ uses."""

    def __init__(self, *, limit: int, unread_limit: int) -> None:
        self._limit, self._unread_limit = limit, unread_limit
        self._by_fd: dict[int, _Connection] = {}
        self._checked_ns = 0

    def accepted(self, fd: int) -> str | None:
        """A new one; why it was cut at once, if it was."""
        self.gone(fd)
        try:
            duplicate = os.dup(fd)
        except OSError:
            return None  # gone already
        try:
            wire = socket.socket(fileno=duplicate)
        except OSError:
            os.close(duplicate)
            return None
        self._by_fd[fd] = _Connection(wire)
        if len(self._by_fd) > self._limit:
            self.cut(fd)
            return f"more than {self._limit} connections at once"
        return None

    def gone(self, fd: int) -> None:
        """ZeroMQ has closed it: so must the duplicate, or the far side would not notice.

        Not shut down: numbers are used again, and where news comes late the duplicate may be of the next connection.
        """
        connection = self._by_fd.pop(fd, None)
        if connection is not None:
            connection.wire.close()

    def cut(self, fd: int) -> None:
        """End it; ZeroMQ notices, and reports that it is gone."""
        connection = self._by_fd.get(fd)
        if connection is not None:
            with suppress(OSError):
                # Ended by a reset: a sender against a closed window would else hang on for a minute.
                connection.wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                connection.wire.shutdown(socket.SHUT_RDWR)

    def consumed(self, fd: int, size: int, parts: int) -> None:
        """A whole message came out."""
        connection = self._by_fd.get(fd)
        if connection is not None:
            connection.consumed += size + parts * _OVERHEAD

    def over_limit(self) -> list[int]:
        """Descriptors of those that send and send, and make no messages of it. Looks at most every 10 ms."""
        now_ns = time.monotonic_ns()
        if now_ns - self._checked_ns < _CHECK_NS:
            return []
        self._checked_ns = now_ns
        over = []
        for fd, connection in self._by_fd.items():
            received = _bytes_received(connection.wire)
            connection.consumed = min(connection.consumed, received)
            if received - connection.consumed > self._unread_limit:
                over.append(fd)
        return over

    def close(self) -> None:
        """Let go, without ending what ZeroMQ is still sending."""
        for connection in self._by_fd.values():
            connection.wire.close()
        self._by_fd.clear()


def _bytes_received(wire: socket.socket) -> int:
    """Of a TCP connection since it began; 0 of a local socket, of which the kernel does not count them."""
    with suppress(OSError, struct.error):
        if wire.family != socket.AF_UNIX:
            info = wire.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 192)
            return int(_BYTES_RECEIVED.unpack_from(info, _BYTES_RECEIVED_AT)[0])
    return 0
