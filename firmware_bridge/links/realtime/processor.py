"""Scheduling of the tick loop by the operating system.

`RealtimeProducer`, for an autopilot that runs by its own clock: real-time priority for the thread that prepares the
frames. The sender's own priority does not help while the producer waits for a processor: on a busy machine most late
samples are late before they reach the sender. The producer's priority is below the sender's (80) and the kernel's
interrupt threads (50). It sleeps between ticks; if it never does, the kernel still leaves 5 % of the time to others.

`LockstepProcessors`, for an autopilot in lockstep that the bench started, has two arrangements:

shared     One processor for both, the autopilot's threads first, the bench when all of them are idle. A simulator and
           its autopilot take turns in lockstep, but an autopilot with many threads (PX4) answers a step before all of
           them have finished with it: the rest happens at another simulated time in each run. On one processor, with
           the bench at the lowest priority (SCHED_IDLE, if the system permits leaving it again), the next step is only
           sent when no thread of the autopilot is ready to run.
separate   One processor for the bench, the others for the autopilot. The bench records while the autopilot computes,
           and the rest of the autopilot's threads run while the bench computes: they wait less for
           each other, and timing is less repeatable. It needs two processors that other programs leave free.

Other programs on the shared processor run before the bench, too. `watch`, called now and then, ends the arrangement if
that has made the bench slow.
"""

from __future__ import annotations

import ctypes
import os
import resource
import time
from contextlib import suppress
from pathlib import Path

from firmware_bridge.links.realtime.sender_process import lock_memory, set_timer_slack

_PRODUCER_PRIORITY = 40


class RealtimeProducer:
    """Context manager: the calling thread runs with SCHED_FIFO inside, where permitted, and as before outside.

    Its memory is locked and its timer slack is 1 ns meanwhile. Threads and processes that it starts run normally. On a
    machine with one processor it asks for no priority: a bench that cannot keep up would leave no time to other
    programs. `denied` tells what was asked for and not granted.
    """

    denied: tuple[str, ...] = ()
    _raised = False
    _locked = False

    def __enter__(self) -> RealtimeProducer:
        found = []
        if not hasattr(os, "sched_setscheduler") or len(os.sched_getaffinity(0)) < 2:
            found.append("real-time priority (it needs Linux and two processors or more)")
        else:
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRODUCER_PRIORITY))
                self._raised = True
            if not self._raised:
                found.append("real-time priority")
        # With a finite limit a later allocation could fail.
        self._locked = _may_lock_memory() and lock_memory(on_fault=True)
        if not self._locked:
            found.append("locked memory")
        if not set_timer_slack(1):
            found.append("exact timers")
        self.denied = tuple(found)
        return self

    def __exit__(self, *_: object) -> None:
        set_timer_slack(0)
        if self._locked:
            ctypes.CDLL(None).munlockall()
            self._locked = False
        if self._raised:
            # The flag stays: without privileges it cannot be taken back.
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            self._raised = False


def _may_lock_memory() -> bool:
    """Return True if this process may lock any amount of memory."""
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY


def _may_come_back() -> bool:
    """Return True if this process may leave SCHED_IDLE again: entering is always permitted, leaving by RLIMIT_NICE."""
    if os.geteuid() == 0:
        return True
    limit = resource.getrlimit(resource.RLIMIT_NICE)[0]
    return limit == resource.RLIM_INFINITY or limit >= 20 - os.getpriority(os.PRIO_PROCESS, 0)


class LockstepProcessors:
    """Context manager. Does nothing without a process, with too few processors, or without this scheduling."""

    def __init__(self, pid: int | None, *, share: bool) -> None:
        self._pid = pid
        self._share = share
        self._before: tuple[set[int], int] | None = None
        self._watched_ns = 0

    @property
    def shared(self) -> bool:
        """True while both use one processor."""
        return self._share and self._before is not None

    @property
    def separate(self) -> bool:
        """True while each has its own."""
        return not self._share and self._before is not None

    def watch(self, simulated_ns: int) -> str | None:
        """Check the speed over `simulated_ns` since the last call. Return a text if the arrangement was ended."""
        now_ns = time.monotonic_ns()
        took_ns, self._watched_ns = now_ns - self._watched_ns, now_ns
        if not self.shared or took_ns < simulated_ns:
            return None
        self._release()
        return "other programs use the processor that bench and autopilot shared: they no longer share one"

    def __enter__(self) -> LockstepProcessors:
        if self._pid is None or not hasattr(os, "SCHED_IDLE"):
            return self
        allowed = os.sched_getaffinity(0)
        processor = max(allowed)  # interrupts tend to go to the first
        theirs = {processor} if self._share else allowed - {processor}
        if not theirs:
            return self
        try:
            for task in Path(f"/proc/{self._pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), theirs)
            before = (allowed, os.sched_getscheduler(0))
            os.sched_setaffinity(0, {processor})
            if self._share and _may_come_back():
                os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        except OSError:
            return self
        self._before = before
        self._watched_ns = time.monotonic_ns()
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            self._release()

    def _release(self) -> None:
        assert self._before is not None
        allowed, policy = self._before
        self._before = None
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, os.sched_param(0))
        os.sched_setaffinity(0, allowed)
        with suppress(OSError):  # the autopilot may have ended
            for task in Path(f"/proc/{self._pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), allowed)
