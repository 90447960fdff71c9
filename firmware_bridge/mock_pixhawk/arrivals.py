"""How regularly IMU samples arrive.

In HITL a sample is stamped when it arrives, so a late one is a wrong one: PX4 integrates it over the wrong interval and
takes what results for an accelerometer bias. On PX4, 2.6 % of samples more than 20 ms late were enough.

Nobody tells the board when a sample should have come. Lateness is followed instead: a gap makes the samples behind it
late by what it was too long, samples that come faster than usual work that off (they had queued), and samples at the
usual pace show that the bench has merely paused.
"""

from __future__ import annotations

from collections import deque

LATE_US = 20_000
_WINDOW = 500  # samples: 2 s at 250 Hz
_BAD, _GOOD = 10, 5  # late samples in the window: 2 %, and 1 % to be well again
_MEAN_OVER = 256  # samples
_USUAL_US = 4_000.0  # pace before any is known
_LONGEST_US = 100_000.0  # of an interval, in the mean: longer ones are pauses


class Arrivals:
    """Judges the arrivals of one stream."""

    def __init__(self) -> None:
        self.bad = False
        self.late_samples = 0  # in the window
        self.longest_gap_us = 0
        self._last_us: int | None = None
        self._mean_us = _USUAL_US
        self._lateness_us = 0.0
        self._window: deque[bool] = deque([False] * _WINDOW, _WINDOW)

    def note(self, t_us: int) -> None:
        """A sample arrived at `t_us`."""
        last, self._last_us = self._last_us, t_us
        if last is None:
            return
        interval_us = t_us - last
        self.longest_gap_us = max(self.longest_gap_us, interval_us)
        excess_us = interval_us - self._mean_us
        self._lateness_us = max(0.0, self._lateness_us + excess_us)
        if abs(excess_us) < 0.5 * self._mean_us:
            self._lateness_us *= 0.5
        self._mean_us += (min(interval_us, _LONGEST_US) - self._mean_us) / _MEAN_OVER
        late = self._lateness_us > LATE_US
        self.late_samples += late - self._window[0]
        self._window.append(late)
        self.bad = self.late_samples >= (_GOOD if self.bad else _BAD)
