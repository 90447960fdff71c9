"""Points of a map: peaks that stand out, between bins, with direction.

Equations: sim/native/radar/processing_points.hpp.

`speed_mps` is what the radar sees, modulo 2 v_max; an echo faster than v_max is shifted in range by the coupling of the
speed that it seems to have, (v - v_seen) f_c / S short.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RadarCfar, RadarPeaks
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import likeness, ratio_table, side_lobes

POINT_DTYPE = np.dtype(
    [
        ("x_R", "<f4"),
        ("y_R", "<f4"),
        ("z_R", "<f4"),
        ("range_m", "<f4"),
        ("speed_mps", "<f4"),
        ("azimuth_rad", "<f4"),
        ("elevation_rad", "<f4"),
        ("snr_db", "<f4"),
    ]
)


class Cfar:
    """CFAR detector of one radar's maps. Formulas of the thresholds: sim/native/radar/cfar.hpp."""

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


class PointFinder:
    """Points of one radar's maps, strongest first."""

    def __init__(
        self,
        chirp: Chirp,
        rx_positions_m: Sequence[Sequence[float]],
        processing: Processing,
        maps: RangeDoppler,
    ) -> None:
        self._room = processing.max_points
        self._maps = maps
        range_lobes, range_null = side_lobes(maps.fast_window, 2 * maps.columns, maps.columns)
        speed_lobes, speed_null = side_lobes(maps.slow_window, maps.rows, maps.rows // 2)
        first = int(processing.min_range_m / maps.range_step_m + 0.999)
        # Of the sweep at the middle of the samples, half a sample before the centre of the sweep.
        middle_hz = chirp.center_frequency_hz - 0.5 * chirp.slope_hz_per_s / chirp.sample_rate_hz
        self._native = RadarPeaks(
            Cfar(maps, len(rx_positions_m), processing).native,
            positions_m=[(float(p[0]), float(p[1]), float(p[2])) for p in rx_positions_m],
            wavelength_m=chirp.wavelength_m,
            range_step_m=maps.range_step_m,
            speed_step_mps=maps.speed_step_mps * chirp.center_frequency_hz / middle_hz,
            coupling_s=middle_hz / chirp.slope_hz_per_s,
            first_column=max(maps.quiet_columns, first),
            range_ratio=ratio_table(maps.fast_window, 2 * maps.columns),
            speed_ratio=ratio_table(maps.slow_window, maps.rows),
            range_lobes=range_lobes,
            speed_lobes=speed_lobes,
            nulls=(range_null, speed_null),
        )

    def find(self, power: NDArray[np.float32]) -> NDArray[np.void]:
        """Points of the map that was computed last; a new array of POINT_DTYPE."""
        found = np.empty((self._room, 8), np.float32)
        count = self._native.find(self._maps.native, power, found)
        return found[:count].copy().view(POINT_DTYPE)[:, 0]
