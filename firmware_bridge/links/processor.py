"""What the tick loop asks of the system's scheduler.

For an autopilot that waits for nobody (`RealtimeProducer`): real-time priority for the thread that prepares the frames.
The sender's own priority is of no use while the producer waits for a processor: on a busy machine most late samples are
late before they are handed over. The producer's priority stands below the sender's (80) and the kernel's interrupt
threads (50). It sleeps between ticks; should it never, the kernel still leaves 5 % of the time to others.

For one in lockstep that the bench started (`SharedProcessor`): one processor for both, the autopilot's threads first,
the bench when all are idle. A lockstep simulator and its autopilot take turns, but an autopilot with many threads (PX4)
answers a step before all of them are done with it: what is left over happens at another simulated time in each run. On
one processor, with the bench at the lowest priority there is (SCHED_IDLE, if the system lets it out again), the next
step is only sent when no thread of the autopilot wants to run. That also saves waking up a second processor at every
step.

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

_PRODUCER_PRIORITY = 40


class RealtimeProducer:
    """Context manager: the calling thread runs with SCHED_FIFO inside, where permitted, and as before outside.

    Threads and processes that it starts meanwhile run normally. On a machine with one processor nothing is asked for: a
    bench that cannot keep up would leave it to nobody else.
    """

    _raised = False

    def __enter__(self) -> RealtimeProducer:
        if hasattr(os, "sched_setscheduler") and len(os.sched_getaffinity(0)) >= 2:
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRODUCER_PRIORITY))
                self._raised = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._raised:
            # The flag stays: without privileges it cannot be taken back.
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            self._raised = False


def _may_come_back() -> bool:
    """Whether this process may leave SCHED_IDLE again: anybody may enter, but not everybody leave (RLIMIT_NICE)."""
    if os.geteuid() == 0:
        return True
    limit = resource.getrlimit(resource.RLIMIT_NICE)[0]
    return limit == resource.RLIM_INFINITY or limit >= 20 - os.getpriority(os.PRIO_PROCESS, 0)


class SharedProcessor:
    """Context manager; does nothing where the system does not offer it."""

    def __init__(self, pid: int | None) -> None:
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
        except OSError:
            return self
        self._before = before
        self._looked_ns = time.monotonic_ns()
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
