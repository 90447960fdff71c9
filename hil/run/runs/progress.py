"""Progress of a run on the console.

On a terminal it is a bar with simulated time, speed relative to real time, phase, waypoints and time left. Otherwise,
as in a CI log, it is one line about every ten seconds of simulated time.
"""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Self, TextIO

from signals.time import NS_PER_S
from sim.scene.work_progress import State

_BAR_PERIOD_S = 0.1  # wall time between two updates of the bar
_COUNT_LINE_PERIOD_S = 5.0  # without a terminal: wall time between two lines of a `CountProgress`
_LINE_PERIOD_NS = 10 * NS_PER_S  # without a terminal: simulated time between two lines


class ProgressDisplay:
    """A progress bar with a line of text, shown only on a terminal. Use as a context manager."""

    def __init__(self, name: str, *, quiet: bool, stream: TextIO | None, clock: Callable[[], float]) -> None:
        self._name, self._clock = name, clock
        self._stream = stream or sys.stdout
        self._quiet = quiet or self._stream is None or self._stream.closed
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        if not self._quiet and self._stream.isatty():
            # rich takes a tenth of a second to import; a run without a terminal does not need it
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as RichProgress

            self._bar = RichProgress(
                TextColumn("[bold]{task.description}"),
                BarColumn(bar_width=None),
                TextColumn("{task.fields[text]}", markup=False),
                *self._columns(),
                console=Console(file=self._stream, emoji=False),
                auto_refresh=False,  # no second thread: it would disturb the timing of the run
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task(self._name, total=None, text="starting")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            with contextlib.suppress(OSError, ValueError):
                self._bar.stop()
            self._bar = None

    def _columns(self) -> list[Any]:
        """Return the columns of the bar that follow the text."""
        return []


class CountProgress(ProgressDisplay):
    """Display of how many of a number of things are done: a bar on a terminal, elsewhere a line every few seconds."""

    def __init__(
        self,
        name: str,
        total: int,
        *,
        quiet: bool,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(name, quiet=quiet, stream=stream, clock=clock)
        self._total = total
        self._next_s = -math.inf

    def text(self, done: int, now_s: float) -> str:
        """Return the text beside the bar."""
        raise NotImplementedError

    def show(self, done: int) -> None:
        """Display that `done` are done; calls within the display's period are ignored."""
        now_s = self._clock()
        if self._quiet or now_s < self._next_s:
            return
        text = self.text(done, now_s)
        with contextlib.suppress(OSError, ValueError):  # the terminal or pipe has been closed
            if self._bar is not None:
                self._next_s = now_s + _BAR_PERIOD_S
                self._bar.update(self._task, total=self._total, completed=done, text=text, refresh=True)
            else:
                self._next_s = now_s + _COUNT_LINE_PERIOD_S
                print(text, file=self._stream, flush=True)


def minutes(seconds: float) -> str:
    """Return a duration for people."""
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"


class Progress(ProgressDisplay):
    """Progress of one run. Call `tick` after every tick.

    `status` returns (phase text, waypoints reached, waypoints) and is called only for an update of the display.
    `sim_limit_ns` is the greatest length of the run, 0 if it is unknown.
    """

    def __init__(
        self,
        *,
        tick_ns: int,
        sim_limit_ns: int = 0,
        status: Callable[[], tuple[str, int, int]],
        title: str = "",
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._tick_ns = tick_ns
        self._limit_ns = sim_limit_ns
        self._status = status
        super().__init__(title or "run", quiet=quiet, stream=stream, clock=clock)
        self._started_s = self._shown_s = clock()
        self._line_ns = 0

    def __enter__(self) -> Self:
        self._started_s = self._clock()
        return super().__enter__()

    def _columns(self) -> list[Any]:
        from rich.progress import TimeRemainingColumn

        return [TimeRemainingColumn(compact=True)]

    def tick(self, tick: int) -> None:
        """Update the display after `tick` ticks, if an update is due."""
        if self._quiet:
            return
        t_ns = tick * self._tick_ns
        try:
            if self._bar is None:
                self._print_line(t_ns)
            else:
                self._update_bar(t_ns)
        except (OSError, ValueError):  # the terminal or pipe was closed; the flight goes on
            self._quiet = True

    def _speed(self, t_ns: int, now_s: float) -> float:
        return t_ns / NS_PER_S / max(now_s - self._started_s, 1e-6)

    def _print_line(self, t_ns: int) -> None:
        if t_ns < self._line_ns:
            return
        self._line_ns = (t_ns // _LINE_PERIOD_NS + 1) * _LINE_PERIOD_NS
        phase, reached, waypoints = self._status()
        speed = f"{self._speed(t_ns, self._clock()):.1f}x real time" if t_ns else "starting"
        progress = f", {reached} of {waypoints} waypoints" if waypoints else ""
        print(f"t = {t_ns / NS_PER_S:6.1f} s  {speed}  {phase}{progress}", file=self._stream, flush=True)

    def _update_bar(self, t_ns: int) -> None:
        now_s = self._clock()
        if t_ns and now_s - self._shown_s < _BAR_PERIOD_S:
            return
        self._shown_s = now_s
        phase, reached, waypoints = self._status()
        text = f"{t_ns / NS_PER_S:.1f} s  {self._speed(t_ns, now_s):.1f}x  {phase}"
        if waypoints:
            text += f"  {reached} of {waypoints} waypoints"
        # Waypoints predict the end better than the time limit, which only failing runs reach.
        total, done = (float(waypoints), float(reached)) if waypoints else (self._limit_ns or None, float(t_ns))
        self._bar.update(self._task, total=total, completed=done, text=text, refresh=True)


class MapProgress(ProgressDisplay):
    """Progress of the import of a map: a bar on a terminal, elsewhere nothing. Its name is the map's file."""

    def __init__(self, source: str, *, stream: TextIO | None = None) -> None:
        super().__init__(source, quiet=False, stream=stream, clock=time.monotonic)
        self._quiet = self._quiet or not self._stream.isatty()

    def show(self, state: State) -> None:
        """Display a state of the work."""
        if self._bar is None:
            return
        text = f"{state.done} of {state.total} {state.what}" if state.total else state.what
        with contextlib.suppress(OSError, ValueError):  # the terminal has been closed
            self._bar.update(self._task, total=state.total or None, completed=state.done, text=text, refresh=True)


@contextlib.contextmanager
def map_progress(source: str) -> Iterator[Callable[[State], None]]:
    """Open the display of a map's import, and return what shows a state in it."""
    with MapProgress(source) as display:
        yield display.show
