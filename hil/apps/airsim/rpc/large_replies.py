"""Replies of many numbers, which a client in plain Python unpacks slowly: the log says so once.

`airsim` 1.8.1 needs msgpack-rpc-python and that needs msgpack-python 0.5.6, whose C code does not compile under Python
3.9 or newer, so that pip installs it in plain Python. It begins with a reply anew at every 64 kB that arrive: 307,200
numbers take 2 to 5 s under Python 3.10 and 3.11, and 0.01 s under Python 3.8 or with rpc-msgpack. The messages of all
these look alike, so nothing but the size decides; only Cosys-AirSim's client, which has rpc-msgpack, is known by its
requests.
"""

from __future__ import annotations

from collections.abc import Callable

LARGE_NUMBERS = 100_000  # about 0.4 s


class LargeReplies:
    """Watches the replies of one server."""

    def __init__(self, log: Callable[[str], None]) -> None:
        self._log = log
        self._told = False

    def note(self, name: str, count: int) -> None:
        """Take notice of a reply of method `name` with `count` numbers."""
        if count < LARGE_NUMBERS or self._told:
            return
        self._told = True
        self._log(
            f"a reply of {name} has {count:,} numbers: AirSim's client takes seconds to unpack it under Python 3.9 or "
            "newer, where msgpack-rpc-python is plain Python; with rpc-msgpack in its place it takes hundredths of a "
            "second ('The client' in docs/airsim.md)"
        )
