"""Which sweeps are new. A LiDAR that hangs sends the same one again, with its old stamp or with a new one.

A sweep of the very same points is no news of its own where the vehicle has moved since it first came; at rest, a LiDAR
without noise says the same again and again.
"""

from __future__ import annotations

import numpy as np

from hil_companion.frame import Sample

_MOVED_M = 0.2
_EVERY = 7  # which point is compared


class FreshSweeps:
    """Asked once for each sweep, in order."""

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._points = b""
        self._first_W = np.zeros(2)  # where the vehicle was when these points first came

    def take(self, sweep: Sample, *, now_ns: int, p_W: np.ndarray) -> bool:
        """Whether it shows what is there now; `p_W`: where the vehicle is."""
        t_ns = int(sweep.t_capture_ns)
        if t_ns > now_ns or (self._t_ns is not None and t_ns <= self._t_ns):
            return False
        points = np.asarray(sweep["points_L"], np.float32).reshape(-1, 3)[::_EVERY].tobytes()
        if points != self._points:
            self._points, self._first_W = points, np.array(p_W[:2], float)
        elif len(points) and not float(np.hypot(*(p_W[:2] - self._first_W))) < _MOVED_M:
            return False
        self._t_ns = t_ns
        return True
