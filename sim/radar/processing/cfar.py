"""CFAR set up for a radar's maps. Formulas of the thresholds: sim/native/radar/cfar.hpp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RadarCfar
from sim.radar.processing.parameters import Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import likeness


class Cfar:
    """Detector of one radar's maps."""

    def __init__(self, maps: RangeDoppler, receivers: int, processing: Processing) -> None:
        """Raises ValueError for a map too small."""
        p = processing.cfar
        problem = p.problem_with(maps.rows, maps.columns)
        if problem:
            raise ValueError(problem)
        half_rows, half_columns = p.guard_doppler + p.train_doppler, p.guard_range + p.train_range
        cells = {
            (d, r)
            for d in range(-half_rows, half_rows + 1)
            for r in range(-half_columns, half_columns + 1)
            if abs(d) > p.guard_doppler or abs(r) > p.guard_range
        }
        self.likeness = likeness(maps.fast_window, maps.slow_window, 2 * maps.columns, maps.rows, cells)
        self.native = RadarCfar(
            rows=maps.rows,
            columns=maps.columns,
            kind=p.kind,
            guard=(p.guard_doppler, p.guard_range),
            train=(p.train_doppler, p.train_range),
            rank=p.rank,
            false_alarm=p.false_alarm,
            receivers=receivers,
            likeness=self.likeness,
            quiet_rows=maps.quiet_rows,
            quiet_columns=maps.quiet_columns,
        )

    def detect(self, power: NDArray[np.float32]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Every cell above its threshold, and the noise power about each (NaN where nothing trains)."""
        mask, noise = np.empty(power.shape, np.uint8), np.empty(power.shape)
        self.native.detect(power, mask, noise)
        return mask.astype(np.bool_), noise
