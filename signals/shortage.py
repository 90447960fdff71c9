"""Resources that ran out, recognised in whatever error a library raises.

NumPy raises MemoryError, the loader of libraries ImportError, OpenCV, MuJoCo and PyTorch errors of their own with the
system's words, `threading` RuntimeError. None of these is a defect of the bench.
"""

from __future__ import annotations

import errno
import mmap
import re
import resource
import sys

from signals.errors import DiskFull, HilError, OutOfFiles, OutOfMemory, Shortage

_WORDS = re.compile(
    r"alloc\w* .*\bmemory|\bmemory .*alloc|(not enough|insufficient|out of) memory|bad[ _]alloc|"
    r"failed to map segment|can't start new thread",
    re.IGNORECASE | re.DOTALL,
)
_PROBE_BYTES = 64 << 20
_FULL = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
_FILES = frozenset((errno.EMFILE, errno.ENFILE))
_HINT = "use smaller pictures, fewer sensors or vehicles, fewer --workers, or a machine with more memory"
# Texts for a process that a native library ended (signals/native/crash_guard.hpp).
OUT_OF_MEMORY = f"no memory is left, and a native library ended the bench: {_HINT}"
CRASHED = "a native library crashed and ended the bench; HIL_TRACEBACK=1 leaves the crash to the system's tools"


def named(error: BaseException) -> HilError | None:
    """Return the error that names what ran out, or `error` itself if it is one of the bench; None: it is neither."""
    if isinstance(error, HilError):
        return error
    return shortage(error)


def shortage(error: BaseException) -> Shortage | None:
    """Return the error that names what ran out; None: nothing did, as far as one can tell."""
    number = getattr(error, "errno", None)  # of OSError, and of ZeroMQ's own
    text = " ".join(str(error).split())
    if number in _FILES:
        return OutOfFiles(f"no file descriptor is left ({text}); raise the limit, for example with `ulimit -n 1024`")
    if number in _FULL:
        return DiskFull(f"no space is left ({text}); what was written before is kept. Free some space")
    if isinstance(error, MemoryError) or number == errno.ENOMEM or _WORDS.search(text) or not has_memory():
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> (20 if sys.platform == "darwin" else 10)
        what = f"{text}; " if text else ""
        return OutOfMemory(f"no memory is left ({what}{used} MB are in use): {_HINT}")
    return None


def has_memory() -> bool:
    """Return True if this process can get more memory; errors without words may have their cause here."""
    try:
        mmap.mmap(-1, _PROBE_BYTES).close()
    except (OSError, ValueError, MemoryError):
        return False
    return True
