"""Processor time of a flight: without the set-up and the end of the run, and whatever else the machine does."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from hil.run.part import Part


class FlightCost(Part):
    """Measures the processor time of all ticks, in the run's own thread and in the whole process."""

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
