"""Memory for what is received: freed blocks are kept, not given back to the system.

ZeroMQ asks for new memory for every part of a message. Blocks of some hundred kilobytes come straight from the system
and go straight back to it, and every page of them is made anew with every frame: a third of the time of a frame of a
megabyte. Told to keep them, glibc serves them from what the frame before has left.
"""

from __future__ import annotations

import ctypes
import sys

KEPT_BYTES = 1 << 29  # in all, before anything is given back
LARGEST_BYTES = 1 << 25  # of one block; glibc takes no more
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def keep_freed_memory() -> bool:
    """For the whole process; False where the C library has no such switch (then all works as before)."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False  # musl
    return bool(mallopt(_M_MMAP_THRESHOLD, LARGEST_BYTES)) and bool(mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES))
