"""Localisation by the true pose, with the SLAM's map, to test planning and flight alone.

hil run rigs/explore.yaml --set companion.settings.localiser=truth
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil_companion.errors import CutError
from hil_companion.explore.mapping.scan import make_scan
from hil_companion.explore.mapping.slam import Slam, SlamEstimate
from hil_companion.explore.mapping.slam_settings import SlamSettings
from hil_companion.explore.mapping.sweep import make_sweep
from hil_companion.navigation.inertial import NavState

_SIGMA_M = 0.01


class TruePose(Slam):
    """A SLAM with one particle at the pose of the topic `truth`."""

    def __init__(self, settings: SlamSettings, *, start_W: tuple[float, float, float, float], seed: int) -> None:
        super().__init__(settings, start_W=start_W, seed=seed)
        self._inertial.cov = np.eye(15) * _SIGMA_M**2

    def update(self, frame: Any) -> SlamEstimate:
        if "truth" not in frame:
            raise CutError("explore: localiser 'truth' needs the topic truth; the bench sends none")
        truth, topic, inertial = frame["truth"], self.settings.lidar_topic, self._inertial
        p, v, q = (tuple(float(c) for c in truth[name]) for name in ("p_WB", "v_WB_W", "q_WB"))
        now = NavState(int(frame.t_ns), p, v, q)  # type: ignore[arg-type]
        inertial.record(now)
        if topic in frame and self._fresh.is_new(frame[topic], now_ns=now.t_ns, p_W=np.array(p)):
            then = inertial.state_at(int(frame[topic].t_capture_ns))
            if then is not None:
                inertial.set_state(then)
                self._map(frame[topic], then)
        inertial.set_state(now)
        self.particles.pose[:] = (p[0], p[1], inertial.yaw_rad)
        return self._estimate(now.t_ns)

    def _map(self, lidar: Any, then: NavState) -> None:
        sweep = make_sweep(self._inertial, lidar, self.settings)
        if sweep.returns:
            self.particles.pose[:] = (then.p[0], then.p[1], self._inertial.yaw_rad)
            self._insert(make_scan(sweep, self.settings, then.p[2]), all_particles=True)
            self._sweep_ns = then.t_ns
