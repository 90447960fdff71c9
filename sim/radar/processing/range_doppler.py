"""Range-Doppler maps: raw samples in, power in counts^2 out. Equations in sim/native/radar/processing_map.hpp.

Transforms have the length of the next power of two, times the padding asked for: 64 x 64 samples make a map of 64 rows
of 32 cells. Row M'/2 is zero speed; rows rise with speed from -v_max; columns are ranges from 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RadarMap
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.windows import window

_MAIN_LOBE = {"none": 1, "hann": 2, "hamming": 2, "blackman": 3, "taylor": 2}  # half of it, in bins, about


class RangeDoppler:
    """Maps of one radar's frames. Holds the learned background, where there is one, and the last frame's spectra."""

    def __init__(self, chirp: Chirp, receivers: int, processing: Processing, isa: str = "") -> None:
        self.fast_window = window(processing.range_window, chirp.samples)
        self.slow_window = window(processing.doppler_window, processing.pulses(chirp))
        self.native = RadarMap(
            receivers=receivers,
            chirps=chirp.chirps,
            samples=chirp.samples,
            pad_chirps=processing.doppler_padding,
            pad_samples=processing.range_padding,
            clutter=processing.clutter,
            remove_chirp_mean=processing.remove_chirp_mean,
            fast_window=self.fast_window,
            slow_window=self.slow_window,
            isa=isa,
        )
        self.rows, self.columns = self.native.shape
        # Rows about zero speed, where clutter removal takes noise and all, and columns about zero range, where the mean
        # is or was.
        slow_null = -(-self.rows * _MAIN_LOBE[processing.doppler_window] // len(self.slow_window))
        fast_null = -(-2 * self.columns * _MAIN_LOBE[processing.range_window] // chirp.samples)
        still = processing.clutter in ("mean", "mti2", "mti3")
        self.quiet_rows = [still and abs(row - self.rows // 2) < slow_null for row in range(self.rows)]
        self.quiet_columns = fast_null
        # Of one cell.
        self.range_step_m = SPEED_OF_LIGHT_MPS * chirp.sample_rate_hz / (4.0 * chirp.slope_hz_per_s * self.columns)
        self.speed_step_mps = 2.0 * chirp.max_speed_mps / self.rows

    def compute(self, raw: NDArray[np.uint16], background_gain: float = 0.0) -> NDArray[np.float32]:
        """A new map of (receivers, chirps, samples)."""
        power = np.empty((self.rows, self.columns), np.float32)
        self.native.compute(raw, background_gain, power)
        return power

    def spectrum(self, receiver: int) -> NDArray[np.complex128]:
        """X of one receiver in the last frame, unscaled, rows as in the map."""
        re, im = np.empty((self.rows, self.columns)), np.empty((self.rows, self.columns))
        self.native.spectrum(receiver, re, im)
        spectrum: NDArray[np.complex128] = re + 1j * im
        return spectrum

    def reset(self) -> None:
        """Forget the background."""
        self.native.reset()
