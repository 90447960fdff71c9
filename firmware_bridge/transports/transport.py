"""What every wire can do."""

from __future__ import annotations

from typing import Protocol


class Transport(Protocol):
    """One wire to one far side. `name` is what a person calls it: a path, an address.

    `open` raises `PortNotFound`, `PortBusy` or another `LinkError`. After the far side has gone, `read`
    (once all it said has been read) and `write` raise `LinkClosed`. `close` may be called at any time, any
    number of times.
    """

    @property
    def name(self) -> str: ...

    def open(self) -> None:
        """Take hold of the wire."""
        ...

    def close(self) -> None:
        """Let go of the wire."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`, or raise `LinkClosed`.

        Never waits for ever, even if the far side also only writes.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at least one byte, waiting up to `timeout_s` of wall clock for it; else b""."""
        ...

    def fileno(self) -> int | None:
        """Descriptor to poll for incoming bytes; None if there is none (memory, or not open)."""
        ...
