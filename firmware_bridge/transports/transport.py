"""The interface of every transport."""

from __future__ import annotations

from typing import Protocol


class Transport(Protocol):
    """One connection to one far side. `name` is the path or address, as users write it.

    `open` raises `PortNotFound`, `PortBusy` or another `LinkError`. After the far side has disconnected, `write` raises
    `LinkClosed`, and so does `read` once all received bytes have been read. `close` may be called at any time, any
    number of times.
    """

    @property
    def name(self) -> str: ...

    def open(self) -> None:
        """Open the connection."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`, or raise `LinkClosed`.

        Bounded in time, even if the far side also only writes.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return received bytes, waiting up to `timeout_s` of wall clock for the first; b"" if none came."""
        ...

    def fileno(self) -> int | None:
        """Return the descriptor to poll for incoming bytes; None if there is none (memory, or not open)."""
        ...
