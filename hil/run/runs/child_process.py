"""Child processes that end with the process that started them."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading

from signals._kernel import unguard_crashes

_PR_SET_PDEATHSIG = 1  # Linux: prctl(2)
_CRASHES = (signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS)  # of the system, or of a library in need


def become_child() -> None:
    """Let this process end with its parent, even by a crash, and leave Ctrl-C to the parent.

    The parent also tells how this process ended (`how_ended`).
    """
    unguard_crashes()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    elif (parent := multiprocessing.parent_process()) is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def how_ended(exit_code: int | None) -> str:
    """Return how a child process ended, in words; `exit_code` as of multiprocessing, negative for a signal."""
    if exit_code is None or exit_code >= 0:
        return f"ended with status {exit_code}"
    number = -exit_code
    hint = ", as happens when memory runs out: use fewer --workers, or smaller pictures" if number in _CRASHES else ""
    return f"was ended by {signal.Signals(number).name}{hint}"
