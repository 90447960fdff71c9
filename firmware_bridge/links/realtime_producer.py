"""Real-time priority for the thread that prepares the frames.

The sender's own priority is of no use while the producer waits for a processor: on a busy machine most late samples are
late before they are handed over. The producer's priority stands below the sender's (80) and the kernel's interrupt
threads (50). It sleeps between ticks; should it never, the kernel still leaves 5 % of the time to others.
"""

from __future__ import annotations

import os
from types import TracebackType

PRODUCER_PRIORITY = 40


class RealtimeProducer:
    """Context manager: the calling thread runs with SCHED_FIFO inside, where permitted, and as before outside.

    Threads and processes that it starts meanwhile run normally. `scheduling` says in words what was granted. On a
    machine with one processor nothing is asked for: a bench that cannot keep up would leave it to nobody else.
    """

    def __init__(self, priority: int = PRODUCER_PRIORITY) -> None:
        self.scheduling = "normal scheduling"
        self._priority = priority
        self._raised = False

    def __enter__(self) -> RealtimeProducer:
        if not hasattr(os, "sched_setscheduler"):
            self.scheduling = "normal scheduling (this system knows no other)"
        elif len(os.sched_getaffinity(0)) < 2:
            self.scheduling = "normal scheduling (there is only one processor)"
        else:
            self._raise()
        return self

    def _raise(self) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(self._priority))
        except OSError as error:
            self.scheduling = f"normal scheduling (SCHED_FIFO {self._priority} refused: {error.strerror})"
        else:
            self._raised = True
            self.scheduling = f"SCHED_FIFO {self._priority}"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._raised:
            # The flag stays: without privileges it cannot be taken back.
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            self._raised = False
            self.scheduling = "normal scheduling"
