"""A connection inside one process: the far side is an object, called synchronously."""

from __future__ import annotations

from typing import Protocol

from signals.errors import LinkClosed


class Peer(Protocol):
    """The far side of a loopback."""

    def boot(self) -> bytes:
        """Return the bytes that the far side sends first, before it has received any. Called once per `open`."""
        ...

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return all bytes that the far side sends because of it."""
        ...


class LoopbackTransport:
    """Carries bytes to `peer` and back without threads, sockets or waiting: the same bytes as over any other transport.

    No bytes can arrive without a write, so `read` returns at once, whatever its timeout. An exception of one of the
    classes in `deaths`, raised by the peer, counts as its crash: `LinkClosed` here.
    """

    def __init__(self, peer: Peer, *, deaths: tuple[type[Exception], ...] = ()) -> None:
        self._peer = peer
        self._deaths = deaths
        self._dead: str | None = None
        self._inbox = b""
        self._open = False

    @property
    def name(self) -> str:
        return "loopback"

    def open(self) -> None:
        self._open = True
        self._dead = None
        self._inbox = self._peer.boot()

    def close(self) -> None:
        self._open = False
        self._inbox = b""

    def write(self, data: bytes) -> None:
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open; call `open` first")
        if self._dead is None:
            try:
                self._inbox += self._peer.feed(data)
            except self._deaths as death:
                # As on a real line, the write does not notice the crash; the next read does.
                self._dead = f"the far side died ({type(death).__name__}: {death})"

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 (nothing to wait for)
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open; call `open` first")
        data, self._inbox = self._inbox, b""
        if not data and self._dead is not None:
            raise LinkClosed(self.name, self._dead)
        return data

    def fileno(self) -> int | None:
        return None
