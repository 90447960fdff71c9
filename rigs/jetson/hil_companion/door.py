"""The short way between a bench and its client on one machine: a local socket of sequenced packets.

Arrays lie in shared memory, so there is little to say. A message by ZeroMQ goes through a thread at both ends; here it
is one system call and one wake-up. Everything after the welcome goes this way, in order.
"""

from __future__ import annotations

import socket

from hil_companion.errors import BadMessage, CompanionError, ConnectionLost

PACKET_BYTES = 64 << 10  # a bench says less; what is longer is cut off by the kernel
WAIT_S = 5.0


class Door:
    """Connected, and the word said. Afterwards it never waits."""

    def __init__(self, path: str, word: str) -> None:
        self.path = path
        self._room = bytearray(PACKET_BYTES + 1)
        self._view = memoryview(self._room)
        self._wire = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._wire.settimeout(WAIT_S)
            self._wire.connect(path)
            self._wire.send(word.encode("ascii", "replace"))
            self._wire.setblocking(False)
        except (OSError, ValueError) as error:
            self.close()
            raise CompanionError(
                f"{path}: the bench cannot be reached there ({error}); from another container, or as another user,"
                " connect without shared memory (--no-shared-memory)"
            ) from error

    def fileno(self) -> int:
        return self._wire.fileno()

    def send(self, message: bytes) -> None:
        """To a bench that has gone nothing is said; what it said before can still be received, and then the loss."""
        try:
            self._wire.send(message, socket.MSG_NOSIGNAL)
        except BlockingIOError:
            raise ConnectionLost(f"{self.path}: the bench takes no more messages") from None
        except (BrokenPipeError, ConnectionResetError):
            pass
        except OSError as error:
            raise ConnectionLost(f"{self.path}: the connection was lost ({error.strerror})") from error

    def receive(self) -> list[memoryview] | None:
        """The next packet, good until the next call; None if there is none. ConnectionLost once it has ended."""
        try:
            try:
                size = self._wire.recv_into(self._room)
            except ConnectionResetError:  # it ended with something of ours unread: what it said before that is here
                size = self._wire.recv_into(self._room)
        except BlockingIOError:
            return None
        except OSError as error:
            raise ConnectionLost(f"{self.path}: the connection was lost ({error.strerror})") from error
        if size == 0:
            raise ConnectionLost(f"{self.path}: the connection was lost")
        if size > PACKET_BYTES:
            raise BadMessage(f"a packet of more than {PACKET_BYTES} bytes")
        return [self._view[:size]]

    def finish(self) -> None:
        """A packet comes whole."""

    def close(self) -> None:
        self._wire.close()
