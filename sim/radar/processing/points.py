"""Points of a map: its peaks, interpolated between bins, with their directions.

A peak is a cell above its CFAR threshold and above its eight neighbours. With the amplitudes a-, a0, a+ of a cell and
its neighbours, and W the spectrum of the window, an echo d bins off the cell has

    (a+ - a-) / (a- + a0 + a+) = (|W(1 - d)| - |W(1 + d)|) / (|W(1 + d)| + |W(d)| + |W(1 - d)|)

which grows with d: the inverse of its table gives d without bias for any window and padding. The beat frequency of a
moving echo is shifted by its Doppler frequency at the middle of the sweep, so with the slope S

    R = range_step (k + d_range) - v f_c / S.

A peak that may be a side lobe of a stronger one is dropped. The lobes of a peak form a cross about it, by the two
windows, and another cross about its mirror image: samples are real, so an echo also appears at minus its range and
speed.

`speed_mps` is the apparent speed, modulo 2 v_max; the range of an echo faster than v_max is corrected with its apparent
speed, and is short by (v - v_apparent) f_c / S.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_asin, det_atan2, det_log
from sim.radar.chirp import Chirp
from sim.radar.processing.cfar import Cfar, Places
from sim.radar.processing.directions import Directions
from sim.radar.processing.parameters import Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import ratio_table, side_lobes

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

_DECIBELS_PER_NEPER = 4.34294481903251827651  # 10 / ln 10
# counts^2. Rounding to counts leaves 1e-4 in a map of 64 x 64; anything less is rounding of doubles.
_LEAST_POWER = np.float32(1e-12)
_LOBE_MARGIN = 4.0  # a peak between cells loses up to 3 dB, its lobes do not; lobes of two peaks may add
_MOST_DECIBELS = 200.0  # signal-to-noise ratio of a peak without noise
_BESIDE = [(d, e) for d in (-1, 0, 1) for e in (-1, 0, 1) if (d, e) != (0, 0)]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


class PointFinder:
    """Finds the points of one radar's maps, strongest first."""

    def __init__(
        self,
        chirp: Chirp,
        rx_positions_m: Sequence[Sequence[float]],
        processing: Processing,
        maps: RangeDoppler,
    ) -> None:
        self._room = processing.max_points
        self._maps = maps
        self._cfar = Cfar(maps, len(rx_positions_m), processing)
        self._directions = Directions(rx_positions_m, chirp.wavelength_m)
        self._first_column = max(1, maps.quiet_columns, int(processing.min_range_m / maps.range_step_m + 0.999))
        # Frequency at the middle of the samples, half a sample before the centre of the sweep.
        middle_hz = chirp.center_frequency_hz - 0.5 * chirp.slope_hz_per_s / chirp.sample_rate_hz
        self._speed_step_mps = maps.speed_step_mps * chirp.center_frequency_hz / middle_hz
        self._coupling_s = middle_hz / chirp.slope_hz_per_s
        self._range_ratio = ratio_table(maps.fast_window, 2 * maps.columns)
        self._speed_ratio = ratio_table(maps.slow_window, maps.rows)
        range_lobes, self._range_null = side_lobes(maps.fast_window, 2 * maps.columns, maps.columns)
        speed_lobes, self._speed_null = side_lobes(maps.slow_window, maps.rows, maps.rows // 2)
        self._range_lobes, self._speed_lobes = np.array(range_lobes), np.array(speed_lobes)

    def find(self, power: Float32) -> NDArray[np.void]:
        """Return the points of the map that was computed last: a new array of POINT_DTYPE."""
        rows, columns = self._peaks(power)
        noise = self._cfar.noise(power, rows, columns)
        height = power[rows, columns].astype(np.float64)
        above = np.flatnonzero(height > self._cfar.threshold(rows, columns) * noise)
        above = above[np.argsort(-height[above], kind="stable")]
        kept = above[self._without_lobes(height[above], rows[above], columns[above])]
        return self._points(power, rows[kept], columns[kept], noise[kept])

    def _peaks(self, power: Float32) -> tuple[Places, Places]:
        """Return rows and columns of cells above their eight neighbours. Of equal cells the first is the peak."""
        inner = power[:, 1:-1]
        peak = inner > _LEAST_POWER
        for d, e in _BESIDE:
            beside = np.roll(power, -d, axis=0)[:, 1 + e : power.shape[1] - 1 + e]
            peak &= inner > beside if (d, e) < (0, 0) else inner >= beside
        peak[:, : self._first_column - 1] = False
        rows, columns = np.nonzero(peak)
        return rows, columns + 1

    def _without_lobes(self, height: Float64, rows: Places, columns: Places) -> list[int]:
        """Return the peaks, strongest first, that are no side lobes, up to the limit of points."""
        kept: list[int] = []
        for i in range(len(height)):
            row, column = rows[kept], columns[kept]
            limit = _LOBE_MARGIN * height[kept]
            lobe = height[i] < limit * self._lobes(rows[i] - row, columns[i] - column)
            mirrored = height[i] < limit * self._lobes(rows[i] + row - self._maps.rows, columns[i] + column)
            if not (lobe | mirrored).any():
                kept.append(i)
            if len(kept) == self._room:
                break
        return kept

    def _lobes(self, rows: Places, columns: Places) -> Float64:
        """Return the greatest power of side lobes so many cells off a peak, relative to it; 0 within its main lobe."""
        rows, columns = np.abs(rows) % self._maps.rows, np.abs(columns)
        rows = np.minimum(rows, self._maps.rows - rows)
        columns = np.minimum(columns, 2 * self._maps.columns - columns)
        main = (rows <= self._speed_null) & (columns <= self._range_null)
        lobes: Float64 = np.where(main, 0.0, self._speed_lobes[rows] * self._range_lobes[columns])
        return lobes

    def _points(self, power: Float32, rows: Places, columns: Places, noise: Float64) -> NDArray[np.void]:
        whole = self._maps.rows
        amplitude = np.sqrt(power.astype(np.float64))
        here = amplitude[rows, columns]
        above, below = amplitude[(rows + 1) % whole, columns], amplitude[rows - 1, columns]
        speed = self._speed_step_mps * (rows - whole // 2 + _bins_off(self._speed_ratio, below, here, above))
        speed[speed < -0.5 * self._speed_step_mps * whole] += self._speed_step_mps * whole
        off = _bins_off(self._range_ratio, amplitude[rows, columns - 1], here, amplitude[rows, columns + 1])
        range_m = self._maps.range_step_m * (columns + off) - self._coupling_s * speed
        directions = self._directions.find(self._maps.spectra(rows, columns))
        height = power[rows, columns].astype(np.float64)
        snr = np.minimum(height / np.maximum(noise, 1e-20 * height), 1e20)
        points = np.empty(len(rows), POINT_DTYPE)
        for axis, name in enumerate(("x_R", "y_R", "z_R")):
            points[name] = range_m * directions[:, axis]
        points["range_m"], points["speed_mps"] = range_m, speed
        points["azimuth_rad"] = [det_atan2(y, x) for x, y, _ in directions.tolist()]
        points["elevation_rad"] = [det_asin(z) for _, _, z in directions.tolist()]
        points["snr_db"] = [min(_MOST_DECIBELS, _DECIBELS_PER_NEPER * det_log(ratio)) for ratio in snr.tolist()]
        return points


def _bins_off(table: Sequence[float], before: Float64, here: Float64, after: Float64) -> Float64:
    """Return the offset of a peak from its cell, -0.5 to 0.5 bins; `table`: at d = 0 ... 0.5 in equal steps."""
    ratio = (after - before) / (before + here + after)
    found: Float64 = np.copysign(np.interp(np.abs(ratio), table, np.linspace(0.0, 0.5, len(table))), ratio)
    return found
