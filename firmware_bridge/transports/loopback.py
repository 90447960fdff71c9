"""A wire inside one process: the far side is an object, called synchronously."""

from __future__ import annotations

from typing import Protocol

from hil.signals.errors import LinkClosed


class Peer(Protocol):
    """The far side of a loopback."""

    def boot(self) -> bytes:
        """What the far side says before it has heard anything. Called once per `open`."""
        ...

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return all that it makes the far side say."""
        ...


class LoopbackTransport:
    """Carries bytes to `peer` and back without threads, sockets or waiting: the same bytes as over any other wire.

    Nothing can arrive while nobody writes, so `read` with nothing there returns at once, whatever its limit.
    An exception of one of the classes in `deaths`, raised by the peer, is its way to die: `LinkClosed` here.
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
            raise LinkClosed(self.name, "the loopback is not open")
        if self._dead is None:
            try:
                self._inbox += self._peer.feed(data)
            except self._deaths as death:
                # As on a real wire, the writer does not notice: whoever reads does.
                self._dead = f"the far side died ({type(death).__name__}: {death})"

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 (nothing to wait for)
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open")
        data, self._inbox = self._inbox, b""
        if not data and self._dead is not None:
            raise LinkClosed(self.name, self._dead)
        return data

    def fileno(self) -> int | None:
        return None
