"""Pictures between a run and its page's server: in memory that both see, beside the wire.

A picture on the wire is copied four times by the run and three times by the server. Here the run copies it once and
the server encodes it where it lies. Two slots, in turn: the server asks for an update while it encodes the one before,
and never for a third, so a slot is not written to before its reader has done with it.

The run makes the memory and says in `begin` where it is; the server says with every request whether it can see it.
What has no room, and everything where there is no such memory (it is Linux's), goes over the wire as before.
"""

from __future__ import annotations

import mmap
import os
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SLOT_BYTES = 8 << 20  # of memory that is only taken where it is written to
_ALIGNED = 64


class Shelf:
    """The run's end: puts arrays there."""

    def __init__(self) -> None:
        self.path: str | None = None  # where the server finds it
        self._memory: mmap.mmap | None = None
        self._slot, self._at = 0, 0
        if sys.platform == "linux":
            try:
                self._fd = os.memfd_create("hil-dash", os.MFD_CLOEXEC)
                os.ftruncate(self._fd, 2 * _SLOT_BYTES)
                self._memory = mmap.mmap(self._fd, 2 * _SLOT_BYTES)
                self.path = f"/proc/{os.getpid()}/fd/{self._fd}"
            except OSError:
                self._memory = None

    def turn(self) -> None:
        """A new update begins."""
        self._slot, self._at = 1 - self._slot, 0

    def put(self, array: NDArray[Any]) -> Any:
        """What stands for the array's bytes in a message: where they are, or they themselves."""
        end = self._at + array.nbytes
        if self._memory is None or end > _SLOT_BYTES:
            return array.tobytes()
        begin = self._slot * _SLOT_BYTES + self._at
        np.copyto(np.ndarray(array.shape, array.dtype, self._memory, begin), array)
        self._at = -(-end // _ALIGNED) * _ALIGNED
        return [begin, array.nbytes]

    def close(self) -> None:
        """The server keeps what it has opened."""
        if self._memory is not None:
            self._memory.close()
            os.close(self._fd)
            self._memory, self.path = None, None


class ShelfReader:
    """The server's end."""

    def __init__(self, path: str) -> None:
        """OSError or ValueError where this process cannot see it."""
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            self._memory = memoryview(mmap.mmap(fd, 0, prot=mmap.PROT_READ))
        finally:
            os.close(fd)

    def found(self, place: Any) -> Any:
        """What `Shelf.put` gave: bytes, or a view of them that holds until the update after the next is asked for."""
        if isinstance(place, bytes):
            return place
        begin, size = place
        return self._memory[begin : begin + size]
