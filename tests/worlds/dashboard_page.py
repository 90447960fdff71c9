"""A dashboard page without a browser: the far end of a run's connection, in a thread."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from typing import Any

from hil.run.feed.live_run import LiveRun
from hil.run.feed.messages import Unpacker, packed
from tests.worlds.patience import PATIENCE_S

Script = Callable[["PageThread", dict[str, Any]], None]


class PageThread:
    """Requests update after update and calls a script with each of them."""

    def __init__(
        self, streams: list[str] | None = None, on_state: Script | None = None, *, closes_after: int = 0
    ) -> None:
        """`closes_after`: number of updates; 0: stays open to the end."""
        self._ours, self._theirs = socket.socketpair()
        self._streams, self._on_state, self._closes_after = streams or [], on_state, closes_after
        self.states: list[dict[str, Any]] = []
        self.others: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._read, daemon=True)

    def live(self, **options: Any) -> LiveRun:
        self._thread.start()
        return LiveRun(self._theirs, **options)

    def say(self, **message: Any) -> None:
        with contextlib.suppress(OSError):  # the run is over; its last messages are still to be read
            self._ours.sendall(packed(message))

    def join(self) -> None:
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def _read(self) -> None:
        unpacker = Unpacker()
        self.say(kind="next", streams=self._streams)
        while True:
            try:
                data = self._ours.recv(1 << 16)
            except OSError:
                return
            if not data:
                return
            for message in unpacker.feed(data):
                if message["kind"] != "state":
                    self.others.append(message)
                    continue
                self.states.append(message)
                if self._on_state is not None:
                    self._on_state(self, message)
                if len(self.states) == self._closes_after:
                    self._ours.close()
                    return
                self.say(kind="next", streams=self._streams)
