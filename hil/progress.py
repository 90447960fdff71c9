"""What a run shows while it flies.

On a terminal a bar: simulated time, speed against real time, phase, waypoint, time left. Elsewhere (a CI log) a line
about every ten seconds of simulated time. In between, a tick costs one comparison of integers: the next tick at
which to look at the clock is chosen from the speed measured so far.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

from hil.signals.time import NS_PER_S

_PERIOD_S = 0.1  # at most ten updates a second of wall time
_LINE_NS = 10 * NS_PER_S  # without a terminal: one line per so much simulated time
_FIRST_TICKS = 8


class Progress:
    """Progress of one run. Use as a context manager; call `tick` in every tick.

    `status` is asked only when something is shown; it returns (phase text, waypoints reached, waypoints).
    `sim_limit_ns` is the length of the run as far as known, 0 where it is not.
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
        self._title = title
        self._clock = clock
        self._stream = stream or sys.stdout
        quiet = quiet or self._stream is None or self._stream.closed
        self._terminal = not quiet and self._stream.isatty()
        self._quiet = quiet
        self._live: Any = None
        self._task: Any = None
        self._started_s = clock()
        self._shown_s = self._started_s
        self._shown_tick = 0
        self._line_ns = 0
        self.next_tick = sys.maxsize if quiet else 0

    def __enter__(self) -> Progress:
        self._started_s = self._shown_s = self._clock()
        if self._terminal:
            self._open_bar()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def tick(self, tick: int) -> None:
        """One tick is done."""
        if tick >= self.next_tick:
            try:
                self._look(tick)
            except (OSError, ValueError):  # whoever read this is gone; the flight goes on
                self.next_tick = sys.maxsize

    def close(self) -> None:
        """Take the bar away; idempotent."""
        if self._live is not None:
            live, self._live = self._live, None
            with contextlib.suppress(OSError, ValueError):
                live.stop()

    def _look(self, tick: int) -> None:
        """Show what there is to show, and choose the tick of the next look.

        With v ticks per second of wall time, the next look is v * 0.1 s ticks away, at most doubled from one look
        to the next, so that a run which suddenly slows down (a late autopilot) does not fall silent for long.
        """
        now_s = self._clock()
        ahead = max(_FIRST_TICKS, tick - self._shown_tick)
        elapsed_s = now_s - self._shown_s
        if elapsed_s < _PERIOD_S and tick:
            speed = (tick - self._shown_tick) / max(elapsed_s, 1e-6)
            missing = int((_PERIOD_S - elapsed_s) * speed) + 1
            self.next_tick = tick + min(missing, ahead)
            return
        self._shown_s, self._shown_tick = now_s, tick
        self.next_tick = tick + min(ahead, max(1, int(ahead * _PERIOD_S / max(elapsed_s, 1e-6))))
        t_ns = tick * self._tick_ns
        if self._live is not None:
            self._update_bar(t_ns, now_s)
        elif t_ns >= self._line_ns:
            self._line_ns = (t_ns // _LINE_NS + 1) * _LINE_NS
            print(self._line(t_ns, now_s), file=self._stream, flush=True)

    def _speed(self, t_ns: int, now_s: float) -> float:
        return t_ns / NS_PER_S / max(now_s - self._started_s, 1e-6)

    def _line(self, t_ns: int, now_s: float) -> str:
        phase, reached, waypoints = self._status()
        speed = f"{self._speed(t_ns, now_s):.1f}x real time" if t_ns else "starting"
        place = f", waypoint {reached}/{waypoints}" if waypoints else ""
        return f"t = {t_ns / NS_PER_S:6.1f} s  {speed}  {phase}{place}"

    def _open_bar(self) -> None:
        # rich takes a tenth of a second to import; runs without a terminal do without it
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        self._live = RichProgress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=None),
            TextColumn("{task.fields[text]}"),
            TimeRemainingColumn(compact=True),
            console=Console(file=self._stream),
            auto_refresh=False,  # no second thread: it would disturb the timing of the run
            transient=True,
        )
        self._live.start()
        self._task = self._live.add_task(self._title or "run", total=None, text="starting")

    def _update_bar(self, t_ns: int, now_s: float) -> None:
        phase, reached, waypoints = self._status()
        text = f"{t_ns / NS_PER_S:.1f} s  {self._speed(t_ns, now_s):.1f}x  {phase}"
        if waypoints:
            text += f"  waypoint {reached}/{waypoints}"
        # Waypoints say more about what is left than the time limit, which is there for runs that fail.
        total, done = (float(waypoints), float(reached)) if waypoints else (self._limit_ns or None, float(t_ns))
        self._live.update(self._task, total=total, completed=done, text=text, refresh=True)
