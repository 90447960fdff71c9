"""Memory for what is received: freed blocks are kept, not given back to the system, and cycles seldom looked for.

ZeroMQ asks for new memory for every part of a message. Blocks of some hundred kilobytes come straight from the system
and go straight back to it, and every page of them is made anew with every frame: a third of the time of a frame of a
megabyte. Told to keep them, glibc serves them from what the frame before has left.
"""

from __future__ import annotations

import ctypes
import gc
import sys

KEPT_BYTES = 1 << 29  # in all, before anything is given back
LARGEST_BYTES = 1 << 25  # of one block; glibc takes no more
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


OBJECTS = 20_000  # made and not freed, before the collector of cycles looks again; a frame is some hundred


def quiet_collector() -> None:
    """What is there now is left alone, and new objects are looked through more seldom: a frame has no cycles in it, and
    at the usual setting looking for them every few frames takes a tenth of a frame's way."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(OBJECTS, *gc.get_threshold()[1:])


def keep_freed_memory() -> bool:
    """For the whole process; False where the C library has no such switch (then all works as before)."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False  # musl
    return bool(mallopt(_M_MMAP_THRESHOLD, LARGEST_BYTES)) and bool(mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES))
