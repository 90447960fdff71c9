"""The true pose in place of the SLAM's, under the map that the SLAM makes: to try planning and flying alone.

hil run rigs/explore.yaml --set companion.settings.localiser=truth
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil_companion.errors import CutError
from hil_companion.explore.inertial import Moment
from hil_companion.explore.scan import make_scan
from hil_companion.explore.slam import Slam, SlamEstimate
from hil_companion.explore.slam_settings import SlamSettings
from hil_companion.explore.sweep import make_sweep

_SIGMA_M = 0.01


class TruePose(Slam):
    """One particle, which is where the topic `truth` says."""

    def __init__(self, settings: SlamSettings, *, start_W: tuple[float, float, float, float], seed: int) -> None:
        super().__init__(settings, start_W=start_W, seed=seed)
        self._inertial.cov = np.eye(15) * _SIGMA_M**2

    def update(self, frame: Any) -> SlamEstimate:
        if "truth" not in frame:
            raise CutError("explore: localiser 'truth' needs the topic truth; the bench sends none")
        truth, topic, inertial = frame["truth"], self.settings.lidar_topic, self._inertial
        p, v, q = (tuple(float(c) for c in truth[name]) for name in ("p_WB", "v_WB_W", "q_WB"))
        now = Moment(int(frame.t_ns), p, v, q)  # type: ignore[arg-type]
        inertial.remember(now)
        if topic in frame and self._fresh.take(frame[topic], now_ns=now.t_ns, p_W=np.array(p)):
            then = inertial.then(int(frame[topic].t_capture_ns))
            if then is not None:
                inertial.stand_at(then)
                self._map(frame[topic], then)
        inertial.stand_at(now)
        self.particles.pose[:] = (p[0], p[1], inertial.yaw_rad)
        return self._estimate(now.t_ns)

    def _map(self, lidar: Any, then: Moment) -> None:
        sweep = make_sweep(self._inertial, lidar, self.settings)
        if sweep.returns:
            self.particles.pose[:] = (then.p[0], then.p[1], self._inertial.yaw_rad)
            self._insert(make_scan(sweep, self.settings, then.p[2]), everybody=True)
            self._sweep_ns = then.t_ns
