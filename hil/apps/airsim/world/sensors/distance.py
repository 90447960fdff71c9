"""Distance sensor: along its x axis to the static scene, + n; the greatest distance where nothing is.

In haze, rain and snow of extinction beta nothing is seen beyond d exp(beta d) = greatest (sim/sensors/range_finder.py).
"""

from __future__ import annotations

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.sensors.sensor import Measured
from signals._kernel import det_exp, rotate_into_world
from signals.frames import frd_from_flu
from signals.noise import NoiseStream
from signals.samples import TruthState
from sim.frame.mount import Mount


class Distance:
    """Distance [m]."""

    latency_s = 0.0

    def __init__(self, name: str, settings: kinds.Distance, measured: Measured) -> None:
        self.rate_hz = settings.rate_hz
        self._settings, self._rays, self._scene = settings, measured.rays, measured.scene
        roll, pitch, yaw = settings.rotation_deg
        self._mount = Mount(frd_from_flu(settings.position_m), (roll, -pitch, -yaw), optical=False)
        self._noise = NoiseStream(1, measured.stream(name), lanes=1)

    def sample(self, seq: int, truth: TruthState) -> float:
        x, y, z = truth.p_WB
        dx, dy, dz = rotate_into_world(truth.q_WB, self._mount.p_BC)
        ahead_W = rotate_into_world(self._mount.attitude(truth), (1.0, 0.0, 0.0))
        hit_m = self._rays.ray_distance((x + dx, y + dy, z + dz), ahead_W)
        most_m, extinction_per_m = self._settings.max_m, self._scene().extinction_per_m
        if extinction_per_m > 0.0 and 0.0 <= hit_m < most_m and hit_m * det_exp(extinction_per_m * hit_m) > most_m:
            hit_m = -1.0
        distance_m = most_m if hit_m < 0.0 else min(hit_m, most_m)
        return distance_m + self._settings.noise_m * self._noise.normal(seq)[0]  # beyond the limits too, as in AirSim
