"""Memory where workers leave their pieces of the recording for the process that puts them together.

Shared between processes that were forked, used again and again, so a piece is copied twice (in and out) and no page is
new to the system after the first batches. A piece that does not fit, or of a worker that was not forked, goes by way of
a file (`hil.dataset.drawing.chunk_path`).
"""

from __future__ import annotations

import mmap
import sys
from collections.abc import Sequence

PLACE_BYTES = 1 << 26  # of address space; what no piece has reached takes no memory


class ChunkPlaces:
    """So many places for one piece each, by number. Make it before processes are forked. None where there is no such
    memory: then `put` puts nothing."""

    def __init__(self, count: int) -> None:
        self._places: list[mmap.mmap] = []
        if sys.platform != "linux":
            return
        flags = mmap.MAP_SHARED | mmap.MAP_ANONYMOUS | getattr(mmap, "MAP_NORESERVE", 0)
        try:
            self._places = [mmap.mmap(-1, PLACE_BYTES, flags=flags) for _ in range(count)]
        except OSError:
            self._places = []

    def put(self, place: int, parts: Sequence[bytes]) -> bool:
        """Whether the parts, one after another, are there now."""
        if not 0 <= place < len(self._places) or sum(map(len, parts)) > PLACE_BYTES:
            return False
        memory = self._places[place]
        at = 0
        for part in parts:
            memory[at : at + len(part)] = part
            at += len(part)
        return True

    def piece(self, place: int, size: int) -> memoryview:
        """What was put there; good until the next `put`. Release it before the places go."""
        return memoryview(self._places[place])[:size]
