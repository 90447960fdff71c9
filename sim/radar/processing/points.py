"""Points of a map: its peaks, interpolated between bins, with their directions.

A peak is a cell above its CFAR threshold and above its eight neighbours. With the amplitudes a-, a0, a+ of a cell and
its neighbours, and W the spectrum of the window, an echo d bins off the cell has

    (a+ - a-) / (a- + a0 + a+) = (|W(1 - d)| - |W(1 + d)|) / (|W(1 + d)| + |W(d)| + |W(1 - d)|)

The ratio grows with d, so the inverse of its table gives d without bias for any window and padding. The beat frequency
of a moving echo is shifted by its Doppler frequency at the middle of the sweep, so with the slope S

    R = range_step (k + d_range) - v f_c / S.

With complex samples, which have no mirror image, two smaller effects count: the smear by range migration
(migration.py), and the sweep's lower frequency when the echo was sent, which makes its speed v (1 - 2 R S / (c f_c))
otherwise.

A peak that may be a side lobe of a stronger peak is dropped. The side lobes of the two windows form a cross about a
peak, and with real samples another cross about its mirror image at minus its range and speed.

With transmitters that take turns, the values of the channels are brought to one time before angles are found, with the
turn per chirp of the peak itself (sim/radar/virtual_array.py). An echo beyond the unambiguous speed is brought to a
wrong time, so its angle is wrong, too.

`speed_mps` is the apparent speed, modulo 2 v_max; the range of an echo faster than v_max is corrected with its apparent
speed, and is short by (v - v_apparent) f_c / S.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_asin, det_atan2, det_cos, det_log, det_sin
from signals.units import TURN_RAD
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.processing.cfar import Cfar, Indices
from sim.radar.processing.directions import Directions
from sim.radar.processing.migration import Migration
from sim.radar.processing.parameters import Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import ratio_table, side_lobes
from sim.radar.virtual_array import VirtualArray

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
# [counts^2] Rounding to counts leaves 1e-4 in a map of 64 x 64; far smaller powers are rounding errors of doubles.
_MIN_POWER = np.float32(1e-12)
_LOBE_MARGIN = 4.0  # a peak between cells loses up to 3 dB, its side lobes do not; side lobes of two peaks may add
_MAX_DECIBELS = 200.0  # signal-to-noise ratio of a peak without noise
_NEIGHBOURS = [(d, e) for d in (-1, 0, 1) for e in (-1, 0, 1) if (d, e) != (0, 0)]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Complex128 = NDArray[np.complex128]


class PointFinder:
    """Search for the points of one radar's maps, strongest first."""

    def __init__(
        self,
        chirp: Chirp,
        array: VirtualArray,
        processing: Processing,
        maps: RangeDoppler,
    ) -> None:
        """`chirp`: of one transmitter."""
        self._max_points = processing.max_points
        self._maps = maps
        self._cfar = Cfar(maps, len(array.positions_m), processing)
        self._directions = Directions(array.positions_m, chirp.wavelength_m)
        self._turn_offsets, self._mirrored = array.turn_offsets, chirp.sampling == "real"
        self._first_column = max(1, maps.quiet_columns, int(processing.min_range_m / maps.range_step_m + 0.999))
        # Frequency at the middle of the samples, half a sample before the centre of the sweep.
        middle_hz = chirp.center_frequency_hz - 0.5 * chirp.slope_hz_per_s / chirp.sample_rate_hz
        self._speed_step_mps = maps.speed_step_mps * chirp.center_frequency_hz / middle_hz
        self._coupling_s = middle_hz / chirp.slope_hz_per_s
        self._range_ratio = ratio_table(maps.fast_window, maps.fast_padded)
        self._speed_ratio = ratio_table(maps.slow_window, maps.slow_padded)
        range_lobes, self._range_null = side_lobes(maps.fast_window, maps.fast_padded, maps.fast_padded // 2)
        speed_lobes, self._speed_null = side_lobes(maps.slow_window, maps.slow_padded, maps.rows // 2)
        self._range_lobes, self._speed_lobes = np.array(range_lobes), np.array(speed_lobes)
        self._migration: Migration | None = None
        if not self._mirrored:
            self._migration = Migration(maps.fast_window, maps.fast_padded, maps.slow_window, maps.slow_padded)
        self._repetition_s = chirp.repetition_s

    def find(self, power: Float32) -> NDArray[np.void]:
        """Return the points of the map that was computed last: a new array of POINT_DTYPE."""
        rows, columns = self._peaks(power)
        noise = self._cfar.noise(power, rows, columns)
        height = power[rows, columns].astype(np.float64)
        above = np.flatnonzero(height > self._cfar.threshold(rows, columns) * noise)
        above = above[np.argsort(-height[above], kind="stable")]
        kept = above[self._without_lobes(height[above], rows[above], columns[above])]
        return self._points(power, rows[kept], columns[kept], noise[kept])

    def _peaks(self, power: Float32) -> tuple[Indices, Indices]:
        """Return rows and columns of cells above their eight neighbours; of equal neighbours, the first cell."""
        inner = power[:, 1:-1]
        peak = inner > _MIN_POWER
        for d, e in _NEIGHBOURS:
            neighbour = np.roll(power, -d, axis=0)[:, 1 + e : power.shape[1] - 1 + e]
            peak &= inner > neighbour if (d, e) < (0, 0) else inner >= neighbour
        peak[:, : self._first_column - 1] = False
        rows, columns = np.nonzero(peak)
        return rows, columns + 1

    def _without_lobes(self, height: Float64, rows: Indices, columns: Indices) -> list[int]:
        """Return the indices of peaks that are not side lobes, up to the limit of points. Peaks: strongest first."""
        kept: list[int] = []
        for i in range(len(height)):
            row, column = rows[kept], columns[kept]
            limit = _LOBE_MARGIN * height[kept]
            lobe = height[i] < limit * self._lobes(rows[i] - row, columns[i] - column)
            if self._mirrored:
                lobe |= height[i] < limit * self._lobes(rows[i] + row - self._maps.rows, columns[i] + column)
            if not lobe.any():
                kept.append(i)
            if len(kept) == self._max_points:
                break
        return kept

    def _lobes(self, rows: Indices, columns: Indices) -> Float64:
        """Return the greatest power of side lobes at this distance from a peak, relative to the peak.

        The distance is in cells; the power is 0 within the main lobe.
        """
        rows, columns = np.abs(rows) % self._maps.rows, np.abs(columns)
        rows = np.minimum(rows, self._maps.rows - rows)
        columns = np.minimum(columns, self._maps.fast_padded - columns)
        main = (rows <= self._speed_null) & (columns <= self._range_null)
        lobes: Float64 = np.where(main, 0.0, self._speed_lobes[rows] * self._range_lobes[columns])
        return lobes

    def _points(self, power: Float32, rows: Indices, columns: Indices, noise: Float64) -> NDArray[np.void]:
        row_count = self._maps.rows
        amplitude = np.sqrt(power.astype(np.float64))
        peak = amplitude[rows, columns]
        faster, slower = amplitude[(rows + 1) % row_count, columns], amplitude[rows - 1, columns]
        offset = _bins_off(self._range_ratio, amplitude[rows, columns - 1], peak, amplitude[rows, columns + 1])
        speed_offset = _bins_off(self._speed_ratio, slower, peak, faster)
        phases = np.zeros((len(self._turn_offsets), len(rows)))
        if self._migration is not None:
            metres = self._speed_step_mps * (rows - row_count // 2 + speed_offset) * self._repetition_s
            cells_per_pulse = metres / self._maps.range_step_m
            read = partial(_bins_off, self._range_ratio), partial(_bins_off, self._speed_ratio)
            offset, speed_offset = self._migration.corrected((offset, speed_offset), cells_per_pulse, read)
            if any(self._turn_offsets):
                for later in set(self._turn_offsets):
                    found = self._migration.phases((offset, speed_offset), cells_per_pulse, later)
                    phases[np.array(self._turn_offsets) == later] = found
        turning = rows - row_count // 2 + speed_offset
        speed = self._speed_step_mps * turning
        if self._migration is not None:
            delay_s = 2.0 * self._maps.range_step_m * (columns + offset) / SPEED_OF_LIGHT_MPS
            speed = speed / (1.0 - delay_s / self._coupling_s)
        speed[speed < -0.5 * self._speed_step_mps * row_count] += self._speed_step_mps * row_count
        range_m = self._maps.range_step_m * (columns + offset) - self._coupling_s * speed
        cycles = np.outer(self._turn_offsets, turning / self._maps.slow_padded) + phases
        cells = self._at_one_time(self._maps.spectra(rows, columns), cycles)
        directions = self._directions.find(cells)
        height = power[rows, columns].astype(np.float64)
        snr = np.minimum(height / np.maximum(noise, 1e-20 * height), 1e20)
        points = np.empty(len(rows), POINT_DTYPE)
        for axis, name in enumerate(("x_R", "y_R", "z_R")):
            points[name] = range_m * directions[:, axis]
        points["range_m"], points["speed_mps"] = range_m, speed
        points["azimuth_rad"] = [det_atan2(y, x) for x, y, _ in directions.tolist()]
        points["elevation_rad"] = [det_asin(z) for _, _, z in directions.tolist()]
        points["snr_db"] = [min(_MAX_DECIBELS, _DECIBELS_PER_NEPER * det_log(ratio)) for ratio in snr.tolist()]
        return points

    def _at_one_time(self, cells: Complex128, cycles: Float64) -> Complex128:
        """Return the channels' values as if their transmitters had taken the same chirps.

        `cycles`, (channels, cells): turn of each echo until the turn of the channel's transmitter. In real numbers,
        since numpy's complex product depends on the CPU.
        """
        if not any(self._turn_offsets):
            return cells
        at_middle = np.empty_like(cells)
        for k, turn in enumerate(cycles):
            angle = (-TURN_RAD * turn).tolist()
            c, s = np.array([det_cos(a) for a in angle]), np.array([det_sin(a) for a in angle])
            at_middle[k].real = cells[k].real * c - cells[k].imag * s
            at_middle[k].imag = cells[k].real * s + cells[k].imag * c
        return at_middle


def _bins_off(table: Sequence[float], before: Float64, here: Float64, after: Float64) -> Float64:
    """Return the offset of a peak from its cell, -0.5 to 0.5 bins; `table`: the ratio at d = 0 ... 0.5."""
    ratio = (after - before) / (before + here + after)
    found: Float64 = np.copysign(np.interp(np.abs(ratio), table, np.linspace(0.0, 0.5, len(table))), ratio)
    return found
