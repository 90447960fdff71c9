"""Work that tells its progress, for the process with limits."""

from __future__ import annotations

import time

from sim.scene.work_progress import progress


def count(number: int, each_s: float) -> int:
    """Return `number` after as many steps."""
    for done in range(number):
        progress.tell("steps", done, number)
        time.sleep(each_s)
    return number
