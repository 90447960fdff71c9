"""Threads that draw and encode for pages: whoever flies goes first."""

from __future__ import annotations

import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

_NICE = 10
_THREADS = 2


def polite_threads() -> ThreadPoolExecutor:
    """On Linux each thread has a niceness of its own; a run that this process starts does not inherit it."""
    return ThreadPoolExecutor(_THREADS, thread_name_prefix="page", initializer=_step_back)


def _step_back() -> None:
    if sys.platform == "linux":
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
