"""The bench's shared memory, mapped read-only. The bench copies a frame's arrays there once; they are read in place.

Mapped by its file and not by multiprocessing.shared_memory: before Python 3.13 that one hands the memory to a resource
tracker, which would remove it under the bench when this process ends; and it maps for writing.
"""

from __future__ import annotations

import mmap
from pathlib import Path

from hil_companion.errors import BadMessage, CompanionError
from hil_companion.protocol import Ring

FOLDER = Path("/dev/shm")  # noqa: S108 (where Linux keeps POSIX shared memory; nothing is made there)


def can_map() -> bool:
    """Whether this system shows shared memory as files."""
    return FOLDER.is_dir()


class RingView:
    """The mapped ring."""

    def __init__(self, ring: Ring) -> None:
        path = FOLDER / ring.name
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), ring.bytes, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise CompanionError(
                f"{path}: the bench's shared memory cannot be mapped ({error}); on another machine, or another user's,"
                " connect without it (--no-shared-memory)"
            ) from error
        self.memory = memoryview(self._map)
        self.bytes = ring.bytes

    def view(self, offset: int, size: int) -> memoryview:
        if offset < 0 or offset + size > self.bytes:
            raise BadMessage(f"{size} bytes at {offset} in a ring of {self.bytes}")
        return self.memory[offset : offset + size]
