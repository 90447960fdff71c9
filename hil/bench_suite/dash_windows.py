"""One flight in windows of simulated time, each alone, with an open page, or beside a process that only counts.

A whole flight differs from the next by more than a page costs: machines have their moods, and they last for seconds.
So the page's server is stopped and continued every few tenths of a second, and the flight flown three times, so that
each window is flown once in each state. It is the same work to the bit; what is compared is what it took.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.bench import fly
from hil.bench_suite.dash_server import ServedPages
from hil.config import Bench, save_bench
from hil.dashboard.live_run import LiveRun
from hil.recorder.recorder import Recorder

BEFORE_S = 5.0  # simulated, before the clock is looked at
_WARM_S = 3.0  # wall clock
_COUNTING = "n = 0\nwhile True: n += 1"


class State(IntEnum):
    """Of a window."""

    ALONE = 0
    WATCHED = 1
    BESIDE = 2  # a process that counts


class Spent(NamedTuple):
    """Read where windows meet; of one window, what lies between."""

    wall_s: float
    processor_s: float  # of this process
    updates: float
    looks_s: float
    server_s: float
    page_s: float


class Windows(NamedTuple):
    """Flights with the same panes, window by window."""

    spent: NDArray[np.float64]  # (states, windows, fields of Spent)
    digests: tuple[str, ...]

    def of(self, state: State, field: str) -> NDArray[np.float64]:
        return self.spent[state, :, Spent._fields.index(field)]

    def share(self, field: str, state: State = State.WATCHED) -> float:
        """A second of wall clock in that state."""
        return float(self.of(state, field).sum() / self.of(state, "wall_s").sum())

    def more(self, state: State, field: str) -> NDArray[np.float64]:
        """Of each window: how much more it took than alone, as a share, in logarithms."""
        return np.log(self.of(state, field) / self.of(State.ALONE, field))

    def cost(self, state: State, field: str) -> tuple[float, float]:
        """Share that it took more than alone, by the median of all windows, and the standard error of that."""
        more = self.more(state, field)
        # Of the median of a normal distribution; from the quartiles, which single disturbances do not move.
        sigma = float(np.subtract(*np.percentile(more, [75, 25]))) / 1.349
        return float(np.expm1(np.median(more))), 1.2533 * sigma / len(more) ** 0.5


def fly_windows(
    make: Callable[[float], Bench], out: Path, panes: Sequence[str], *, windows: int, window_s: float
) -> Windows:
    """`make`: a bench that flies for so many seconds of simulated time. HilError."""
    bench = make(BEFORE_S + windows * window_s + 1.0)
    spent = np.empty((len(State), windows, len(Spent._fields)))
    digests = []
    for first in State:
        with ServedPages(out.parent, [panes]) as served, _counting() as counter:
            served.wait_for_page()
            live = LiveRun(served.wire)
            try:
                flight = _Flight(bench, out, live, served, counter, first, windows, window_s)
                digests.append(flight.fly())
            finally:
                served.hold(False)
                live.close()
        for k in range(windows):
            spent[flight.state(k), k] = np.subtract(flight.marks[k + 1], flight.marks[k])
    return Windows(spent, tuple(digests))


def fly_alone(bench: Bench, out: Path) -> str:
    """Nobody has ever looked: the digest. HilError."""
    return _flown(bench, out, None, lambda _reached, _ended: False)


class _Flight:
    """One of the three: window k is in state `first` + k."""

    def __init__(
        self,
        bench: Bench,
        out: Path,
        live: LiveRun,
        served: ServedPages,
        counter: subprocess.Popen[bytes],
        first: State,
        windows: int,
        window_s: float,
    ) -> None:
        self._bench, self._out, self._live, self._served, self._counter = bench, out, live, served, counter
        self._first, self._windows = first, windows
        self._from = round(BEFORE_S * bench.config.tick_hz)
        self._ticks = round(window_s * bench.config.tick_hz)
        self._tick = 0
        self._now = State.WATCHED
        self.marks: list[Spent] = []

    def state(self, window: int) -> State:
        return State((self._first + window) % len(State))

    def fly(self) -> str:
        return _flown(self._bench, self._out, self._live, self._after_tick)

    def _after_tick(self, _reached: Callable[[], int], _ended: bool) -> bool:
        self._tick += 1
        if self._tick == self._from:
            until_s = time.monotonic() + _WARM_S
            while time.monotonic() < until_s:  # the server loads what it draws with, once in its life
                self._live.before_tick()
                time.sleep(0.005)
        since = self._tick - self._from
        if since >= 0 and since % self._ticks == 0 and len(self.marks) <= self._windows:
            self.marks.append(
                Spent(
                    time.perf_counter(),
                    time.process_time(),
                    self._live.updates,
                    self._live.looks_ns * 1e-9,
                    *self._served.processor_s,
                )
            )
            self._turn(self.state(len(self.marks) - 1) if len(self.marks) <= self._windows else State.WATCHED)
        return False  # to its end, so that its digest can be compared

    def _turn(self, state: State) -> None:
        if (state == State.WATCHED) != (self._now == State.WATCHED):
            self._served.hold(state != State.WATCHED)
        if (state == State.BESIDE) != (self._now == State.BESIDE):
            self._counter.send_signal(signal.SIGCONT if state == State.BESIDE else signal.SIGSTOP)
        self._now = state


def _flown(bench: Bench, out: Path, live: LiveRun | None, over: Callable[[Callable[[], int], bool], bool]) -> str:
    out.mkdir(parents=True, exist_ok=True)
    save_bench(bench, out)
    recorder = Recorder(out, mcap=True, tlog=False, tick_ns=bench.config.tick_ns, watch=live)
    try:
        fly(bench, out, recorder, over, live)
    finally:
        recorder.close("PASS")
    return recorder.digest


@contextmanager
def _counting() -> Iterator[subprocess.Popen[bytes]]:
    """A process that counts when it is let to."""
    with subprocess.Popen([sys.executable, "-c", _COUNTING]) as process:
        process.send_signal(signal.SIGSTOP)
        try:
            yield process
        finally:
            process.kill()
