"""Which sweeps are new. A LiDAR that hangs sends the same one again, with its old stamp or with a new one.

Who has noise never says the same twice. Of a LiDAR without any the very same points are no news where the vehicle has
moved since they first came.
"""

from __future__ import annotations

import numpy as np

from hil_companion.frame import Sample

_MOVED_M = 0.2
_AT_REST_M, _DIFFERENT = 0.05, 5  # so many sweeps that differ though the vehicle stays where it is: there is noise
_EVERY = 7  # which point is compared


class FreshSweeps:
    """Asked once for each sweep, in order."""

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._points = b""
        self._first_W = np.zeros(3)  # where the vehicle was when these points first came
        self._rest_W = np.zeros(3)
        self._different = 0

    @property
    def _noisy(self) -> bool:
        return self._different >= _DIFFERENT

    def take(self, sweep: Sample, *, now_ns: int, p_W: np.ndarray) -> bool:
        """Whether it shows what is there now; `p_W`: where the vehicle is."""
        t_ns = int(sweep.t_capture_ns)
        if t_ns > now_ns or (self._t_ns is not None and t_ns <= self._t_ns):
            return False
        points = np.asarray(sweep["points_L"], np.float32).reshape(-1, 3)[::_EVERY].tobytes()
        here_W = np.array(p_W, float)
        if points != self._points:
            self._points, self._first_W = points, here_W
            if not self._noisy:
                stays = float(np.linalg.norm(here_W - self._rest_W)) < _AT_REST_M
                self._different = self._different + 1 if stays else 0
                self._rest_W = self._rest_W if stays else here_W
        elif len(points) and (self._noisy or not float(np.linalg.norm(here_W - self._first_W)) < _MOVED_M):
            return False
        self._t_ns = t_ns
        return True
