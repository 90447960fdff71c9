"""Frames in POSIX shared memory: the bench copies arrays in once, clients on the same machine read them in place.

A slot contains the arrays of one frame, each on a 64-byte boundary. The clients that got its header hold it until they
answer or are lost. Slots are allocated first-fit, not strictly in turn, so that a client that is slow to answer blocks
its own slot only. If no slot fits, the frame is dropped; nothing waits.

The name disappears from /dev/shm as soon as the bench closes; if the bench is killed, Python's resource tracker, a
separate process, removes it. Memory that a client has mapped stays readable to it until it unmaps it.
"""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing import shared_memory
from pathlib import Path

import numpy as np

from signals.errors import PortNotFound

ALIGN = 64
_FOLDER = Path("/dev/shm")  # noqa: S108


class Block:
    """Arrays in C order, laid out one after the other on boundaries of 64 bytes."""

    __slots__ = ("arrays", "size")

    def __init__(self) -> None:
        self.arrays: list[tuple[np.ndarray, int]] = []  # each with its offset
        self.size = 0

    def add(self, array: np.ndarray) -> int:
        """Append an array. Return its offset."""
        offset, size = self.size, array.nbytes
        if size:  # a radar that sees nothing has no points
            self.arrays.append((array, offset))
            self.size += -(-size // ALIGN) * ALIGN
        return offset

    def copy_to(self, view: memoryview) -> None:
        """Copy each array to its offset in `view`."""
        for array, offset in self.arrays:
            view[offset : offset + array.nbytes] = _bytes_of(array)


def _bytes_of(array: np.ndarray) -> memoryview:
    try:
        return array.data.cast("B")
    except (TypeError, ValueError):  # memoryview knows no complex numbers
        return array.reshape(-1).view(np.uint8).data


class _Memory(shared_memory.SharedMemory):
    """Shared memory that is freed with its last view, without a message if that is after its own end."""

    def __del__(self) -> None:
        with suppress(BufferError):
            super().__del__()


class SharedRing:
    """One block of shared memory, and the clients that hold each part of it."""

    def __init__(self, size: int) -> None:
        name = f"hil-companion-{secrets.token_hex(8)}"
        try:
            self._memory = _Memory(name, create=True, size=size)
        except OSError as error:
            raise _unavailable(size, error) from error
        self._view: memoryview | None = None
        try:
            _allocate(name, size)
            assert self._memory.buf is not None
            self._view = self._memory.buf[:size]
            np.frombuffer(self._view, np.uint8)[::4096] = 0  # the system maps the pages now, not in the first frames
        except BaseException as error:  # also Ctrl-C: the name would outlive the bench
            self.close()
            if isinstance(error, OSError):
                raise _unavailable(size, error) from error
            raise
        self.name = self._memory.name
        self.size = size
        self._slots: list[tuple[int, int, set[str]]] = []  # start, end, holders; by start

    def put(self, block: Block, holders: Iterable[str]) -> int | None:
        """Copy a block in. Return where it begins, or None if no slot fits."""
        size = max(block.size, ALIGN)
        gap = self._gap(size)
        if gap is None or self._view is None:
            return None
        index, start = gap
        block.copy_to(self._view[start:])
        self._slots.insert(index, (start, start + size, set(holders)))
        return start

    def _gap(self, size: int) -> tuple[int, int] | None:
        """Return (index among the slots, start) of the first gap that fits, or None."""
        start = 0
        for index, (slot_start, end, _) in enumerate(self._slots):
            if slot_start - start >= size:
                return index, start
            start = end
        return (len(self._slots), start) if self.size - start >= size else None

    def release(self, slot: int, holder: str) -> None:
        """Release the slot for this holder. Does nothing if it holds none there."""
        for index, (start, _, holders) in enumerate(self._slots):
            if start == slot:
                holders.discard(holder)
                if not holders:
                    del self._slots[index]
                return

    def close(self) -> None:
        """Remove the name and unmap the memory. May be called twice."""
        self._view = None
        with suppress(FileNotFoundError):
            self._memory.unlink()
        with suppress(BufferError):  # a view still exists: the memory is freed with it
            self._memory.close()


def _allocate(name: str, size: int) -> None:
    """Reserve the memory: otherwise a write could kill the process. Raise OSError if there is not enough."""
    path = _FOLDER / name
    if path.exists():
        descriptor = os.open(path, os.O_RDWR)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)


def _unavailable(size: int, error: OSError) -> PortNotFound:
    what = f"{size / 2**20:g} MiB of shared memory are not available ({error.strerror or error})"
    if error.errno in (errno.ENOSPC, errno.ENOMEM, errno.EFBIG):
        what += (
            "; give it more (docker run --shm-size=256m), use less (--set companion.ring_mb), or use none "
            "(--set companion.arrangement=one_port)"
        )
    return PortNotFound(str(_FOLDER), what)
