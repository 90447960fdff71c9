"""Frames in POSIX shared memory: the bench copies arrays in once, clients on the same machine read them in place.

A slot holds the arrays of one frame, each on a 64-byte boundary, and is held by the clients that were told of it until
they answer (or are lost). Slots are taken first-fit, not strictly in turn, so that a client that sits on its frame
keeps that slot and no more: the others' frames go round it. When nothing fits, the frame is dropped: nobody waits.

The name is gone from /dev/shm as soon as the bench closes; if the bench is killed, Python's resource tracker, a process
of its own, takes it away. What a client has mapped stays readable to it until it lets go.
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

from hil.signals.errors import PortNotFound

ALIGN = 64
_FOLDER = Path("/dev/shm")  # noqa: S108


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


def _bytes_of(array: np.ndarray) -> memoryview:
    try:
        return array.data.cast("B")
    except (TypeError, ValueError):  # complex numbers are none of memoryview's
        return array.reshape(-1).view(np.uint8).data


class SharedRing:
    """One block of shared memory, and who holds which part of it."""

    def __init__(self, size: int) -> None:
        name = f"hil-companion-{secrets.token_hex(8)}"
        try:
            self._memory = shared_memory.SharedMemory(name, create=True, size=size)
        except OSError as error:
            raise _none(size, error) from error
        try:
            _allocate(name, size)
        except OSError as error:
            self._memory.unlink()
            self._memory.close()
            raise _none(size, error) from error
        self.name = self._memory.name
        self.size = size
        assert self._memory.buf is not None
        view = self._memory.buf[:size]
        np.frombuffer(view, np.uint8)[::4096] = 0  # pages are made now, not under the first frames
        self._view: memoryview | None = view
        self._slots: list[tuple[int, int, set[str]]] = []  # start, end, holders; by start

    def put(self, block: Block, holders: Iterable[str]) -> int | None:
        """Copy a block in; where it begins. None if there is no room."""
        size = max(block.size, ALIGN)
        place = self._gap(size)
        if place is None or self._view is None:
            return None
        index, start = place
        block.copy_to(self._view[start:])
        self._slots.insert(index, (start, start + size, set(holders)))
        return start

    def _gap(self, size: int) -> tuple[int, int] | None:
        """(index among the slots, start) of the first free place."""
        start = 0
        for index, (taken, end, _) in enumerate(self._slots):
            if taken - start >= size:
                return index, start
            start = end
        return (len(self._slots), start) if self.size - start >= size else None

    def give_back(self, slot: int, holder: str) -> None:
        """`holder` has read the slot. One that is not held is passed over."""
        for index, (start, _, holders) in enumerate(self._slots):
            if start == slot:
                holders.discard(holder)
                if not holders:
                    del self._slots[index]
                return

    def close(self) -> None:
        """Take the name away and let go. May be called twice."""
        self._view = None
        with suppress(FileNotFoundError):
            self._memory.unlink()
        with suppress(BufferError):  # somebody still has a view: the memory goes when that does
            self._memory.close()


def _allocate(name: str, size: int) -> None:
    """Memory that is only promised ends the process when it is touched and there is none. OSError."""
    path = _FOLDER / name
    if path.exists():
        descriptor = os.open(path, os.O_RDWR)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)


def _none(size: int, error: OSError) -> PortNotFound:
    what = f"{size / 2**20:g} MiB of shared memory cannot be had ({error.strerror or error})"
    if error.errno in (errno.ENOSPC, errno.ENOMEM, errno.EFBIG):
        what += (
            "; give more room (docker run --shm-size=256m), take less (--set companion.ring_mb), "
            "or do without (--set companion.arrangement=one_port)"
        )
    return PortNotFound(str(_FOLDER), what)
