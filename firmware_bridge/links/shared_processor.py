"""One processor for the bench and the autopilot it started: the autopilot's threads first, the bench when all are idle.

A lockstep simulator and its autopilot take turns, but an autopilot with many threads (PX4) answers a step before all of
them are done with it: what is left over happens at another simulated time in each run. On one processor, with the bench
at the lowest priority there is (SCHED_IDLE, if the system lets it out again), the next step is only sent when no thread
of the autopilot wants to run. That also saves waking up a second processor at every step.

Whatever else wants to run on that processor goes first, too. `watch`, called now and then, gives the arrangement up
where that has made the bench slow.
"""

from __future__ import annotations

import os
import resource
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType


def _may_come_back() -> bool:
    """Whether this process may leave SCHED_IDLE again: anybody may enter, but not everybody leave (RLIMIT_NICE)."""
    if os.geteuid() == 0:
        return True
    limit = resource.getrlimit(resource.RLIMIT_NICE)[0]
    return limit == resource.RLIM_INFINITY or limit >= 20 - os.getpriority(os.PRIO_PROCESS, 0)


class SharedProcessor:
    """Context manager. `granted` says in words what was done; nothing where the system does not offer it."""

    def __init__(self, pid: int | None) -> None:
        self.granted = "no processor shared"
        self._pid = pid
        self._before: tuple[set[int], int] | None = None
        self._looked_ns = 0

    def watch(self, simulated_ns: int) -> str | None:
        """`simulated_ns` have passed since the last call: what was given up, in words, if anything was."""
        now_ns = time.monotonic_ns()
        took_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if self._before is None or took_ns < simulated_ns:
            return None
        self._give_up()
        return "other programs keep the processor busy that bench and autopilot shared: each goes where it likes now"

    def __enter__(self) -> SharedProcessor:
        if self._pid is None or not hasattr(os, "SCHED_IDLE"):
            return self
        allowed = os.sched_getaffinity(0)
        processor = max(allowed)  # interrupts tend to go to the first
        try:
            for task in Path(f"/proc/{self._pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), {processor})
            before = (allowed, os.sched_getscheduler(0))
            os.sched_setaffinity(0, {processor})
            if _may_come_back():
                os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        except OSError as error:
            self.granted = f"no processor shared ({error.strerror})"
            return self
        self._before = before
        self._looked_ns = time.monotonic_ns()
        first = "which goes first" if os.sched_getscheduler(0) == os.SCHED_IDLE else "both alike"
        self.granted = f"processor {processor} shared with the autopilot, {first}"
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            self._give_up()

    def _give_up(self) -> None:
        assert self._before is not None
        allowed, policy = self._before
        self._before = None
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, os.sched_param(0))
        os.sched_setaffinity(0, allowed)
        with suppress(OSError):  # the autopilot may have ended
            for task in Path(f"/proc/{self._pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), allowed)
