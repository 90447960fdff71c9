"""Those who have connected beside ZeroMQ's socket and not said yet, by the word of their welcome, who they are."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from firmware_bridge.companion.unreachable import Unreachable

_WORD_S = 3.0  # for a newcomer to say its word
_WORD_BYTES = 64
_MOST = 64


class Way(Protocol):
    """A connection of one client, beside ZeroMQ: whole messages in order. Never waits."""

    @property
    def unsent_bytes(self) -> int:
        """Taken, and not yet with the kernel: `flush` goes on with it."""

    def fileno(self) -> int: ...

    def send(self, message: bytes) -> bool:
        """Whether there was room. Unreachable if the client has gone."""

    def receive(self) -> memoryview | None:
        """The next message, good until the next call; None while there is none. Unreachable once it has ended."""

    def flush(self) -> None:
        """Unreachable if the client has gone."""

    def close(self) -> None: ...


class Newcomers:
    """Of one listening socket. `make` is the way of a connection, or None for one that is sent away."""

    def __init__(self, listening: socket.socket, make: Callable[[socket.socket], Way | None]) -> None:
        self._listening, self._make = listening, make
        self._waiting: list[tuple[float, Way]] = []

    def serve(self, welcome: Callable[[bytes, Way], bool]) -> None:
        """Let in who says a word that `welcome` knows; the others are sent away."""
        with suppress(OSError):  # nobody is there, or has gone again already
            while True:
                wire, _ = self._listening.accept()
                way = self._make(wire) if len(self._waiting) < _MOST else None
                if way is None:
                    wire.close()
                else:
                    self._waiting.append((time.monotonic() + _WORD_S, way))
        still = []
        for until_s, way in self._waiting:
            try:
                word = way.receive()
            except Unreachable:
                way.close()
                continue
            if word is None and time.monotonic() < until_s:
                still.append((until_s, way))
            elif word is None or not welcome(bytes(word[:_WORD_BYTES]), way):
                way.close()
        self._waiting = still

    def close(self) -> None:
        """May be called twice."""
        for _, way in self._waiting:
            way.close()
        self._waiting = []
