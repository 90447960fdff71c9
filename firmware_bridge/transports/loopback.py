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
    classes in `crashes`, raised by the peer, counts as its crash: `LinkClosed` here.
    """

    def __init__(self, peer: Peer, *, crashes: tuple[type[Exception], ...] = ()) -> None:
        self._peer = peer
        self._crashes = crashes
        self._end_text: str | None = None
        self._inbox = b""
        self._open = False

    @property
    def name(self) -> str:
        return "loopback"

    def open(self) -> None:
        self._open = True
        self._end_text = None
        self._inbox = self._peer.boot()

    def close(self) -> None:
        self._open = False
        self._inbox = b""

    def write(self, data: bytes) -> None:
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open; call `open` first")
        if self._end_text is None:
            try:
                self._inbox += self._peer.feed(data)
            except self._crashes as crash:
                # As on a real line, the write does not notice the crash; the next read does.
                self._end_text = f"the far side died ({type(crash).__name__}: {crash})"

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 (nothing to wait for)
        if not self._open:
            raise LinkClosed(self.name, "the loopback is not open; call `open` first")
        data, self._inbox = self._inbox, b""
        if not data and self._end_text is not None:
            raise LinkClosed(self.name, self._end_text)
        return data

    def fileno(self) -> int | None:
        return None
