"""Timing of benchmarks: processor time, methods in turn, and each counts with its best time.

On a busy machine the wall-clock time of a method is mostly that of other programs. Its processor time still grows by
what they leave in the caches and on the other half of a core, which the best of several turns shows least.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from hil.run.part import Part


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and the threads and processes it starts, on one core (Linux only)."""
    if not hasattr(os, "sched_setaffinity"):
        yield  # not Linux
        return
    previous = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(previous)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, previous)


def best_times(
    methods: Mapping[str, Callable[[], object]],
    *,
    rounds: int = 1,
    once_above_s: float = float("inf"),
    prepare: Callable[[str], None] = lambda _name: None,
) -> dict[str, float]:
    """Return the best processor time [s], of all threads, of each method over `rounds`.

    A method that takes over `once_above_s` runs only once. A round runs every method, so that other load on the machine
    affects all of them. `prepare` is called with a method's name before each of its runs and is not timed.
    """
    best: dict[str, float] = {}
    for _ in range(rounds):
        for name, method in methods.items():
            if best.get(name, 0.0) > once_above_s:
                continue
            prepare(name)
            began = time.process_time()
            method()
            took = time.process_time() - began
            best[name] = min(took, best.get(name, took))
    return best


class FlightCost(Part):
    """Part that measures the processor time of all ticks of a flight, in the run's own thread and in the process."""

    name = "flight_cost"

    def __init__(self) -> None:
        self.thread_s = self.process_s = 0.0

    @contextmanager
    def around_flight(self) -> Iterator[None]:
        began_s = time.thread_time(), time.process_time()
        try:
            yield
        finally:
            self.thread_s, self.process_s = time.thread_time() - began_s[0], time.process_time() - began_s[1]


def processor_s(pid: int) -> float:
    """Return the processor time of all threads of a process [s]; NaN where the system does not tell."""
    try:
        return time.clock_gettime((~pid << 3) | 2)  # Linux: the processor clock of that process
    except (AttributeError, OSError, OverflowError):
        return float("nan")


def resident_mib(pid: int) -> float:
    """Return the resident memory of a process [MiB], or NaN if the system does not report it."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        return float("nan")
