"""Rhythm of a survey: how often it sees everybody again, and what that says of two tracks.

A survey that comes round sees everybody again after about the same time, the revisit time tau: the median gap between
neighbours in the best chains of tracks. So two neighbours in time of one object, with a gap of u = gap / tau,
and an object that is not seen before its first track, or after its last one, for u,

    link(u) = `_ON_TIME`                                if the gap is usual
              `_ON_TIME` - `_MISSED` (u - `_LATE`)      later, `_LEAST` at least
              `_TOO_SOON`                               sooner than 19 of 20 gaps: rather two people take turns
    lost(u) = `_ABSENT` max(0, u - `_LATE_END`)         at most `_GONE`: some are hidden for most of a flight

are the logarithms of their chances, against sightings at any time. A successor b of a saves that a is lost until the
end of the flight, and b until its begin:

    ratio(a, b) = link(u_ab) + lost(u from the end of a on) + lost(u until the begin of b)

Of 1260 gaps of true people on the maps for tuning, the median is 8 s, 5 % are below 5 s, 10 % above 20 s and 5 % above
29 s. `_MISSED` and `_GONE` are milder than these gaps say, and were chosen by the number of errors there, because the
other ratios are surer than they should be.
"""

from __future__ import annotations

from typing import Sequence

import numpy as np

_ON_TIME, _LATE, _MISSED, _LEAST, _TOO_SOON = 0.75, 1.5, 0.3, -5.0, -3.0
_LATE_END, _ABSENT, _GONE = 3.0, 0.35, 1.3
_SOON, _OF_SOON = 0.05, 0.8  # quantile of the gaps, and the share of it below which a gap is too soon
_LEAST_GAPS, _LEAST_REVISIT_S = 8, 2.0


class Rhythm:
    """Revisit time of a survey from `begin_s` to `end_s`, by the gaps [s] between tracks of one object."""

    def __init__(self, gaps_s: Sequence[float], begin_s: float, end_s: float) -> None:
        gaps = [gap for gap in gaps_s if gap > 0.0]
        self._begin_s, self._end_s = begin_s, end_s
        self.known = len(gaps) >= _LEAST_GAPS
        self.revisit_s = max(_LEAST_REVISIT_S, float(np.median(gaps))) if self.known else 0.0
        self._soon_s = _OF_SOON * float(np.quantile(gaps, _SOON)) if self.known else 0.0

    def ratio(self, a_end_s: float, b_begin_s: float) -> float:
        """Return the log-likelihood ratio of a track that begins at `b_begin_s` as the successor of one that ended."""
        return (
            self._link(b_begin_s - a_end_s) + self._lost(self._end_s - a_end_s) + self._lost(b_begin_s - self._begin_s)
        )

    def _link(self, gap_s: float) -> float:
        if 0.0 < gap_s < self._soon_s:
            return _TOO_SOON
        return max(_LEAST, _ON_TIME - _MISSED * max(0.0, gap_s / self.revisit_s - _LATE))

    def _lost(self, absent_s: float) -> float:
        return min(_GONE, _ABSENT * max(0.0, absent_s / self.revisit_s - _LATE_END))
