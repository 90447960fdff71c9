"""What `hil dataset` shows: frames done, rate, time left. A bar on a terminal, elsewhere a line every few seconds."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import TextIO

from hil.progress import Shown

_BAR_S, _LINE_S = 0.1, 5.0


class FrameProgress(Shown):
    """Of the frames of one data set."""

    def __init__(
        self, total: int, *, quiet: bool, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__("dataset", quiet=quiet, stream=stream, clock=clock)
        self._total = total
        self._next_s = 0.0
        self._first: tuple[float, int] | None = None  # when and at how many frames the measured part began

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
                self._bar.update(self._task, total=self._total, completed=done, text=text, refresh=True)
            else:
                self._next_s = now_s + _LINE_S
                print(text, file=self._stream, flush=True)


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
