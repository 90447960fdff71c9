"""Where clients of the shared memory are heard: a local socket of sequenced packets, one connection for each of them.

Arrays lie in the ring; what is left to say about a frame is that it is there, and where. ZeroMQ hands every message to
a thread of its own and from there to the other process's, which costs more than copying a megabyte. So a client that
was let in over ZeroMQ connects here as well, says the word it was told with its welcome, and from then on all its
messages and all to it go this way, in order: one system call each, and one wake-up.

The socket's file can be opened by the bench's own user only (mode 0600), and the kernel tells who connected. What
waits unread is bounded by the kernel, since it takes no more of a sender than the socket's buffer holds.
"""

from __future__ import annotations

import os
import socket
import struct
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from firmware_bridge.companion.newcomers import Newcomers, Way
from firmware_bridge.companion.unreachable import Unreachable
from hil.signals.errors import PortNotFound

_PACKET_BYTES = 64 << 10  # of a client; what is longer is cut off by the kernel, and no message any more
_PATH_BYTES = 107  # sockaddr_un, with the zero behind it 108
_UNREAD = 1024  # packets; more than the kernel holds for a socket
_CREDENTIALS = struct.Struct("=iII")  # pid, uid, gid


class Door:
    """One client's connection. Never waits."""

    unsent_bytes = 0  # the kernel takes a packet whole, or not at all

    def __init__(self, wire: socket.socket) -> None:
        self._wire = wire
        self._room = bytearray(_PACKET_BYTES + 1)
        self._view = memoryview(self._room)

    def fileno(self) -> int:
        return self._wire.fileno()

    def send(self, packet: bytes) -> bool:
        """Whether there was room. Unreachable if the client has gone."""
        try:
            self._wire.send(packet, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return False
        except OSError as error:
            raise Unreachable from error
        return True

    def receive(self) -> memoryview | None:
        """The next packet, good until the next call; None while there is none. Unreachable once it has ended."""
        room, now = self._room, socket.MSG_DONTWAIT
        try:
            try:
                size = self._wire.recv_into(room, 0, now)
            except ConnectionResetError:  # it ended with something of ours unread: what it sent before that is here
                size = self._wire.recv_into(room, 0, now)
        except BlockingIOError:
            return None
        except OSError as error:
            raise Unreachable from error
        if size == 0:
            raise Unreachable
        return self._view[:size]

    def flush(self) -> None:
        """Nothing is ever left."""

    def close(self) -> None:
        """What was said before can still be received there."""
        with suppress(
            OSError
        ):  # with something unread here, the kernel would tell the other side of a broken connection
            for _ in range(_UNREAD):
                self._wire.recv_into(self._room, 0, socket.MSG_DONTWAIT)
        self._wire.close()


class Doors:
    """The listening socket and those who have connected and not said their word yet."""

    def __init__(self, beside: str) -> None:
        """`beside`: the file of ZeroMQ's socket, next to which this one lies. PortNotFound."""
        self._folder: Path | None = None
        self.path = f"{beside}-door"
        self._wire = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._newcomers = Newcomers(self._wire, lambda wire: Door(wire) if _of_this_user(wire) else None)
        try:
            if beside.startswith("@") or len(os.fsencode(self.path)) > _PATH_BYTES:
                self._folder = Path(tempfile.mkdtemp(prefix="hil-companion-"))
                self.path = str(self._folder / "door")
            with suppress(FileNotFoundError):
                os.unlink(self.path)  # of a bench that was killed: nobody listens at `beside`, or it would not be ours
            self._wire.bind(self.path)
            os.chmod(self.path, 0o600)
            self._wire.listen(16)
            self._wire.setblocking(False)
        except OSError as error:
            self.close()
            raise PortNotFound(self.path, f"cannot be listened on ({error.strerror or error})") from error

    def fileno(self) -> int:
        return self._wire.fileno()

    def serve(self, welcome: Callable[[bytes, Way], bool]) -> None:
        """Let in who says a word that `welcome` knows; the others are sent away."""
        self._newcomers.serve(welcome)

    def close(self) -> None:
        """May be called twice."""
        self._newcomers.close()
        if self._wire.fileno() >= 0:
            self._wire.close()
            with suppress(OSError):
                os.unlink(self.path)
        if self._folder is not None:
            with suppress(OSError):
                self._folder.rmdir()


def _of_this_user(wire: socket.socket) -> bool:
    """Or of root, whom no file keeps out either."""
    try:
        told = wire.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    except OSError:
        return False
    return _CREDENTIALS.unpack(told)[1] in (os.geteuid(), 0)
