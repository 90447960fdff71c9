"""Arrays that are to lie together in memory, or behind each other on a wire."""

from __future__ import annotations

import numpy as np

ALIGN = 64
_BETWEEN = bytes(ALIGN)


class Block:
    """Arrays in C order that are to lie together, each on a boundary of 64 bytes."""

    __slots__ = ("arrays", "size")

    def __init__(self) -> None:
        self.arrays: list[tuple[np.ndarray, int]] = []  # each with its offset
        self.size = 0

    def add(self, array: np.ndarray) -> int:
        """Its offset."""
        offset, size = self.size, array.nbytes
        if size:  # a radar that sees nothing has no points
            self.arrays.append((array, offset))
            self.size += -(-size // ALIGN) * ALIGN
        return offset

    def copy_to(self, view: memoryview) -> None:
        """The arrays, each to its offset."""
        for array, offset in self.arrays:
            view[offset : offset + array.nbytes] = _bytes_of(array)

    def pieces(self) -> list[bytes | memoryview]:
        """All of it in order, with what lies between the arrays: for one gathering system call, without a copy."""
        found: list[bytes | memoryview] = []
        for array, _ in self.arrays:
            found.append(_bytes_of(array))
            if array.nbytes % ALIGN:
                found.append(_BETWEEN[: -array.nbytes % ALIGN])
        return found


def _bytes_of(array: np.ndarray) -> memoryview:
    try:
        return array.data.cast("B")
    except (TypeError, ValueError):  # complex numbers are none of memoryview's
        return array.reshape(-1).view(np.uint8).data
