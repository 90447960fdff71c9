"""Range-Doppler maps of raw samples, as power in counts^2.

    x[m, n]  raw minus each chirp's mean (optional) and minus the static clutter
    X[l, k] = sum over m, n of w_slow[m] w_fast[n] x[m, n] exp(-j 2 pi (k n / N' + l m / M'))
    P[row, k] = mean over channels of (2 / (sum w_fast sum w_slow))^2 |X|^2,   row = (l + M' / 2) mod M'

An echo of amplitude A counts, away from the edges of the map, has A^2 at its peak. Transforms have the length of the
next power of two, times the padding: 64 x 64 samples make a map of 64 rows of 32 cells. Row M'/2 is zero speed; speed
rises with the row from -v_max; columns are ranges from 0.

The channels are those of the virtual array: each receiver once for every transmitter. In time division, the chirps of a
channel are those of its transmitter. In Doppler division with D bands they are all chirps, turned back by p m / D
cycles for transmitter p, and of M' rows the middle M' / D are kept: the others hold the echoes of other transmitters.

With complex samples x = I + j Q there is no mirror image: all N' columns are ranges, and (2 / ...) becomes (1 / ...).

Means are weighted by the window of their dimension. A plain mean contains side lobes of moving targets, which its
subtraction would put at zero speed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.processing.parameters import Processing, power_of_two_from
from sim.radar.processing.windows import window
from sim.radar.virtual_array import VirtualArray

Float64 = NDArray[np.float64]
Samples = NDArray[Any]  # float64, or complex128 with complex samples or Doppler bands

_MAIN_LOBE = {"none": 1, "hann": 2, "hamming": 2, "blackman": 3, "taylor": 2}  # half width in bins, approximately


class RangeDoppler:
    """Range-Doppler transform of one radar's frames, with the background and the spectra of the last frame."""

    def __init__(self, chirp: Chirp, array: VirtualArray, processing: Processing) -> None:
        self._raw_shape = (len(array.rx_positions_m) * chirp.parts, chirp.chirps, chirp.samples)
        self._array, self._complex = array, chirp.sampling == "complex"
        bands = max(1, array.doppler_bands)
        channels = len(array.positions_m)
        self._turn_back = _turned_back(array, chirp.chirps) if array.doppler_bands else None
        chirp = chirp.of_one_transmitter(array.turns)
        self._clutter = processing.clutter
        self._remove_chirp_mean = processing.remove_chirp_mean
        self.fast_window = window(processing.range_window, chirp.samples)
        self.slow_window = window(processing.doppler_window, processing.pulses(chirp))
        self._fast, self._slow = np.array(self.fast_window), np.array(self.slow_window)[:, None]
        self._scale = ((1.0 if self._complex else 2.0) / (self._fast.sum() * self._slow.sum())) ** 2 / channels
        self.rows = power_of_two_from(chirp.chirps // bands) * processing.doppler_padding
        self.slow_padded = self.rows * bands
        self.fast_padded = power_of_two_from(chirp.samples) * processing.range_padding
        self.columns = self.fast_padded if self._complex else self.fast_padded // 2
        self._background: Samples | None = None
        self._spectrum = np.zeros((channels, self.rows, self.columns), np.complex128)
        # Quiet rows: near zero speed, where clutter removal also removes noise. Quiet columns: near zero range, which
        # hold a chirp's mean, or have lost noise with it.
        slow_null = -(-self.slow_padded * _MAIN_LOBE[processing.doppler_window] // len(self.slow_window))
        fast_null = -(-self.fast_padded * _MAIN_LOBE[processing.range_window] // chirp.samples)
        removes_noise = processing.clutter in ("mean", "mti2", "mti3")
        self.quiet_rows = [removes_noise and abs(row - self.rows // 2) < slow_null for row in range(self.rows)]
        self.quiet_columns = fast_null
        self.range_step_m = SPEED_OF_LIGHT_MPS * chirp.sample_rate_hz / (2.0 * chirp.slope_hz_per_s * self.fast_padded)
        self.speed_step_mps = 2.0 * chirp.max_speed_mps / self.slow_padded

    def compute(self, raw: NDArray[np.uint16], background_gain: float = 0.0) -> NDArray[np.float32]:
        """Return a new map of samples (channels of the converter, chirps, samples).

        `background_gain` (0 to 1): for `clutter: background`; the first frame initialises the background.
        """
        if raw.dtype != np.uint16:
            raise TypeError(f"raw samples are {raw.dtype}, not uint16")
        if raw.shape != self._raw_shape:
            raise ValueError(f"raw samples do not have the shape {self._raw_shape} (channels, chirps, samples)")
        x = self._by_channel(raw)
        if self._remove_chirp_mean:
            x -= np.sum(x * self._fast, axis=2, keepdims=True) / self._fast.sum()
        x = self._moving(x, background_gain) * self._slow * self._fast
        transform = np.fft.fft if self._complex or self._turn_back is not None else np.fft.rfft
        ranges = transform(x, self.fast_padded, axis=2)[:, :, : self.columns]
        spectrum = np.fft.fftshift(np.fft.fft(ranges, self.slow_padded, axis=1), axes=1)
        first = (self.slow_padded - self.rows) // 2
        self._spectrum = spectrum[:, first : first + self.rows]
        power = np.sum(self._spectrum.real**2 + self._spectrum.imag**2, axis=0)
        return (self._scale * power).astype(np.float32)

    def _by_channel(self, raw: NDArray[np.uint16]) -> Samples:
        """Return the samples of each channel of the virtual array, (channels, its chirps, samples)."""
        x: Samples = raw.astype(np.float64)
        if self._complex:
            x = x[0::2] + 1j * x[1::2]
        if self._turn_back is not None:
            return (x[None] * self._turn_back[:, None, :, None]).reshape(-1, *x.shape[1:])
        turns = self._array.turns
        if turns == 1:
            return x
        receivers, chirps, samples = x.shape
        by_turn = x.reshape(receivers, chirps // turns, turns, samples)
        return np.ascontiguousarray(by_turn.transpose(2, 0, 1, 3)).reshape(-1, chirps // turns, samples)

    def _moving(self, x: Samples, background_gain: float) -> Samples:
        """Return the samples without static clutter. Differences of chirps are scaled to keep white noise's power."""
        if self._clutter == "none":
            return x
        if self._clutter == "mti2":
            return math.sqrt(0.5) * np.diff(x, axis=1)
        if self._clutter == "mti3":
            return math.sqrt(1.0 / 6.0) * np.diff(x, n=2, axis=1)
        mean: Samples = np.sum(x * self._slow, axis=1, keepdims=True) / self._slow.sum()
        if self._clutter == "mean":
            return x - mean
        background = mean if self._background is None else self._background
        self._background = background + background_gain * (mean - background)
        return x - background

    def spectra(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.complex128]:
        """Return X of the last frame in some cells of the map, unscaled: (channels, cells)."""
        return self._spectrum[:, rows, columns]

    def spectrum(self, receiver: int) -> NDArray[np.complex128]:
        """Return X of one channel in the last frame, unscaled, with the rows of the map."""
        return self._spectrum[receiver]

    def reset(self) -> None:
        """Discard the background."""
        self._background = None


def _turned_back(array: VirtualArray, chirps: int) -> NDArray[np.complex128]:
    """Return exp(-2 pi i p m / D) of transmitter p at chirp m, (transmitters, chirps)."""
    bands = array.doppler_bands
    angle = [2.0 * math.pi * j / bands for j in range(bands)]
    table = np.array([complex(det_cos(a), -det_sin(a)) for a in angle])
    return table[np.arange(array.transmitters)[:, None] * np.arange(chirps) % bands]
