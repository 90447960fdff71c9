"""A wire inside one process: the far side is an object, called synchronously."""

from __future__ import annotations

from typing import Protocol

from hil.signals.errors import LinkClosed


class Peer(Protocol):
    """The far side of a loopback."""

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return all that it makes the far side say.

        `feed(b"")` fetches what it says unasked.
        """
        ...


class LoopbackTransport:
    """Carries bytes to `peer` and back without threads, sockets or waiting: the same bytes as over any
    other wire.

    Nothing can arrive while nobody writes, so `read` with nothing there returns at once whatever the time-
    out.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._inbox = b""
        self._open = False

    @property
    def name(self) -> str:
        return "loopback"

    def open(self) -> None:
        self._open = True
        self._inbox = self._peer.feed(b"")

    def close(self) -> None:
        self._open = False
        self._inbox = b""

    def write(self, data: bytes) -> None:
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open")
        self._inbox += self._peer.feed(data)

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 (nothing to wait for)
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open")
        data, self._inbox = self._inbox, b""
        return data

    def fileno(self) -> int | None:
        return None
