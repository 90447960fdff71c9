"""GPS: position and velocity without noise; eph and epv fall exponentially."""

from __future__ import annotations

from typing import NamedTuple

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.sensors.sensor import Measured
from signals._kernel import det_exp
from signals.samples import TruthState
from signals.time import NS_PER_S

_FIX_3D, _FIX_2D, _NO_FIX = 3, 2, 0


class GpsFix(NamedTuple):
    """Measurement of a GPS."""

    truth: TruthState
    eph_m: float
    epv_m: float
    fix_type: int


class Gps:
    """Fix of a GPS."""

    def __init__(self, name: str, settings: kinds.Gps, measured: Measured) -> None:  # noqa: ARG002 (of all sensors)
        self.rate_hz, self.latency_s = settings.rate_hz, settings.latency_s
        self._settings = settings

    def sample(self, seq: int, truth: TruthState) -> GpsFix:
        s, since_s = self._settings, max(0.0, truth.t_ns / NS_PER_S)
        eph, epv = (
            final + (first - final) * det_exp(-since_s / max(tau, 1e-6))
            for first, final, tau in (
                (s.eph_initial_m, s.eph_final_m, s.eph_time_constant_s),
                (s.epv_initial_m, s.epv_final_m, s.epv_time_constant_s),
            )
        )
        fix = _FIX_3D if eph <= s.eph_min_3d_m else _FIX_2D if eph <= s.eph_min_2d_m else _NO_FIX
        return GpsFix(truth, eph, epv, fix if seq / s.rate_hz >= s.startup_s else _NO_FIX)
