"""What `hil dataset` shows: frames done, rate, time left. A bar on a terminal, elsewhere a line every few seconds."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

_BAR_S, _LINE_S = 0.1, 5.0


class FrameProgress:
    """Use as a context manager."""

    def __init__(
        self, total: int, *, quiet: bool, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._total = total
        self._stream = stream or sys.stdout
        self._quiet = quiet or self._stream is None or self._stream.closed
        self._clock = clock
        self._bar: Any = None
        self._task: Any = None
        self._next_s = 0.0
        self._first: tuple[float, int] | None = None  # when and at how many frames the measured part began

    def __enter__(self) -> FrameProgress:
        if not self._quiet and self._stream.isatty():
            # A tenth of a second to import: only who looks at it waits for it.
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            self._bar = Progress(
                TextColumn("[bold]dataset"),
                BarColumn(bar_width=None),
                TextColumn("{task.fields[text]}"),
                console=Console(file=self._stream),
                auto_refresh=False,
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task("dataset", total=self._total, text="taking off")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            with contextlib.suppress(OSError, ValueError):
                self._bar.stop()
            self._bar = None

    def text(self, done: int, now_s: float) -> str:
        """Frames, rate and time left. The rate is that since the first batch came back: take-off does not count."""
        if self._first is None:
            self._first = (now_s, done)
            return f"{done} of {self._total} frames"
        since_s, before = self._first
        rate = (done - before) / max(now_s - since_s, 1e-6)
        if rate <= 0.0:
            return f"{done} of {self._total} frames"
        left_s = (self._total - done) / rate
        return f"{done} of {self._total} frames, {rate:.1f} frames/s, {_minutes(left_s)} left"

    def show(self, done: int) -> None:
        """So many frames are done."""
        now_s = self._clock()
        if self._quiet or (now_s < self._next_s and self._first is not None):
            return
        text = self.text(done, now_s)
        with contextlib.suppress(OSError, ValueError):  # whoever read this is gone
            if self._bar is not None:
                self._next_s = now_s + _BAR_S
                self._bar.update(self._task, completed=done, text=text, refresh=True)
            else:
                self._next_s = now_s + _LINE_S
                print(text, file=self._stream, flush=True)


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
