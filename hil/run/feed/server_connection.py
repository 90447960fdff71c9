"""Socket between a run and the page's server, the run's end."""

from __future__ import annotations

import socket
from typing import Any

from hil.run.feed.messages import Unpacker, packed

_READ_BYTES = 1 << 16


class ServerConnection:
    """Connection that reads and writes messages without blocking, except in `write_last`."""

    def __init__(self, link: socket.socket) -> None:
        self.lost = False  # the page's server is gone; the run goes on without it
        self._link = link
        self._link.setblocking(False)
        self._unpacker = Unpacker()
        self._unsent = memoryview(b"")

    @property
    def busy(self) -> bool:
        """True while part of a message is still unsent."""
        return len(self._unsent) > 0

    def read(self) -> list[dict[str, Any]]:
        """Return the messages that have arrived, from at most 64 KiB a call."""
        if self.lost:
            return []
        try:
            data = self._link.recv(_READ_BYTES)
            self.lost = not data
            return self._unpacker.feed(data)
        except (BlockingIOError, InterruptedError):
            return []
        except (OSError, ValueError):
            self.lost = True
            return []

    def write(self, message: dict[str, Any]) -> None:
        """Begin to send a message. Call it only while not `busy`."""
        self._unsent = memoryview(packed(message))
        self.push()

    def push(self) -> None:
        """Send as much as the socket's buffer takes."""
        while len(self._unsent) and not self.lost:
            try:
                sent = self._link.send(self._unsent)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                self.lost = True
                return
            self._unsent = self._unsent[sent:]

    def write_last(self, message: dict[str, Any], limit_s: float) -> None:
        """Send the last messages of a run: wait until they are sent, for at most `limit_s`."""
        self._link.settimeout(limit_s)
        try:
            self._link.sendall(bytes(self._unsent) + packed(message))
        except OSError:
            self.lost = True

    def close(self) -> None:
        self._link.close()
