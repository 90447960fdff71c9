"""Errors of the sweep: phase noise of the oscillator, and a sweep that is not linear.

The oscillator's frequency is off by df(t). An echo of delay tau is mixed with the same oscillator, so that what remains
of its phase is 2 pi (integral of df over tau), which is 2 pi tau df(t) as long as df changes little within tau (1 % for
offsets to 0.08 / tau): near echoes have little of it (range correlation; Budge and Burt, IEE Radar 93, 1993). With x
the samples and S the slope, this is a shift of the sampling time,

    y(t) = x(t) + (df(t) / S) x'(t),     x'(t) = j 2 pi S tau x(t) of each echo

whose derivative is summed from the echoes as x is. Sidebands of an echo at the offset f then have the power

    L(f) (2 pi f tau)^2    of its own, per hertz, as 4 L(f) sin^2(pi f tau) for f tau << 1

for the oscillator's single-sideband noise L. A sweep error of D cos(2 pi f t) gives a pair of echoes beside each, of
the amplitude pi tau D relative to it (Piper, IEEE Radar 1995, p. 563). `problem_with` limits 2 pi tau df to 0.3.

df has the table `nonlinearity` over the samples of a chirp, the same in each, and noise that is independent from chirp
to chirp: in each bin b of frequency, f_b^2 L(f_b) on either side. Draws are from the stream <name>.phase_noise by the
number of the frame. All channels have the same oscillator.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals._kernel import det_log, det_pow
from signals.documents.validate import StrictModel
from signals.noise import noise_key, normal_from_uniform
from signals.units import TURN_RAD
from sim._kernels import cosines_and_sines
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.echoes import Echoes
from sim.radar.receiver import Receiver
from sim.radar.synthesis import Synthesizer
from sim.radar.virtual_array import VirtualArray

Float64 = NDArray[np.float64]

_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Deviation = Annotated[float, Field(ge=-1e9, le=1e9)]
_Offset = Annotated[float, Field(gt=0.0, le=1e9)]
_Level = Annotated[float, Field(ge=-200.0, le=0.0)]
GREATEST_RAD = 0.3


class Sweep(StrictModel):
    """Errors of the sweep; each may be empty."""

    # Offset from the carrier and single-sideband noise [dBc/Hz]; straight lines over the logarithm of the offset.
    phase_noise: tuple[tuple[_Offset, _Level], ...] = ()
    nonlinearity: tuple[tuple[_Share, _Deviation], ...] = ()  # share of the chirp's samples and deviation [Hz]

    @model_validator(mode="after")
    def _rise(self) -> Sweep:
        for name in ("phase_noise", "nonlinearity"):
            places = [row[0] for row in getattr(self, name)]
            if places != sorted(set(places)):
                raise ValueError(f"{name} must have rising first values")
        if len(self.nonlinearity) == 1:
            raise ValueError("nonlinearity has 1 row; a line needs 2")
        return self

    def noise_at(self, offset_hz: float) -> float:
        """Return L(f) as a ratio per hertz; beyond the table, its ends."""
        rows = self.phase_noise
        if offset_hz <= rows[0][0]:
            return det_pow(10.0, 0.1 * rows[0][1])
        for (f0, l0), (f1, l1) in pairwise(rows):
            if offset_hz <= f1:
                t = (det_log(offset_hz) - det_log(f0)) / (det_log(f1) - det_log(f0))
                return det_pow(10.0, 0.1 * (l0 + t * (l1 - l0)))
        return det_pow(10.0, 0.1 * rows[-1][1])

    def deviations_hz(self, chirp: Chirp) -> list[float]:
        """Return the deviation at each sample; beyond the table, its ends."""
        if not self.nonlinearity:
            return [0.0] * chirp.samples
        out, rows = [], self.nonlinearity
        for n in range(chirp.samples):
            share = (n + 0.5) / chirp.samples
            i = 0
            while i < len(rows) - 2 and share > rows[i + 1][0]:
                i += 1
            (s0, d0), (s1, d1) = rows[i], rows[i + 1]
            t = min(max((share - s0) / (s1 - s0), 0.0), 1.0)
            out.append(d0 + t * (d1 - d0))
        return out

    def amplitudes_hz(self, chirp: Chirp) -> list[float]:
        """Return the amplitudes of the noise of df at the bins 1, 2, ... of frequency."""
        if not self.phase_noise:
            return []
        step_hz = chirp.sample_rate_hz / chirp.samples
        bins = range(1, chirp.samples // 2)
        return [b * step_hz * sqrt(2.0 * self.noise_at(b * step_hz) * step_hz) for b in bins]

    def problem_with(self, chirp: Chirp) -> str:
        """Return why the errors are too great for the chirp's ranges; "" if they are not."""
        delay_s = 2.0 * chirp.max_range_m / SPEED_OF_LIGHT_MPS
        noise_hz = sqrt(sum(a * a for a in self.amplitudes_hz(chirp)))
        worst_hz = max(abs(d) for d in self.deviations_hz(chirp)) + 3.0 * noise_hz
        turned = TURN_RAD * delay_s * worst_hz
        if turned <= GREATEST_RAD:
            return ""
        return (
            f"turns an echo at {chirp.max_range_m:.3g} m by {turned:.3g} rad; the limit is {GREATEST_RAD:g}: "
            f"lower its deviations or its noise"
        )


class SweepErrors:
    """Adds the errors of one radar's sweep to its frames."""

    def __init__(
        self, chirp: Chirp, array: VirtualArray, receiver: Receiver, sweep: Sweep, *, seed: int, name: str
    ) -> None:
        complex_chirp = chirp.model_copy(update={"sampling": "complex"})
        self._synthesizer = Synthesizer(
            complex_chirp, array, hp_cutoff_hz=receiver.hp_cutoff_hz, aaf_cutoff_hz=receiver.aaf_cutoff_hz
        )
        self._both = np.zeros(self._synthesizer.shape)
        self._parts = chirp.parts
        self._chirp = chirp
        self._per_m = TURN_RAD * 2.0 * chirp.slope_hz_per_s / SPEED_OF_LIGHT_MPS
        self._fixed_s = np.array(sweep.deviations_hz(chirp)) / chirp.slope_hz_per_s
        self._amplitude_s = np.array(sweep.amplitudes_hz(chirp)) / chirp.slope_hz_per_s
        self._key = np.array(noise_key(seed, f"{name}.phase_noise"), np.uint64)
        n = np.arange(chirp.samples)
        self._turns = [
            _cos_sin((b * n % chirp.samples) * (TURN_RAD / chirp.samples)) for b in range(1, chirp.samples // 2)
        ]

    def shifts_s(self, seq: int) -> Float64:
        """Return df / S of frame `seq`, (chirps, samples)."""
        shift = np.tile(self._fixed_s, (self._chirp.chirps, 1))
        bins = len(self._amplitude_s)
        if bins == 0:
            return shift
        count = 2 * bins * self._chirp.chirps
        raw = np.random.Philox(counter=[0, 0, 0, seq], key=self._key).random_raw(count)
        uniform = ((raw >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
        draws = normal_from_uniform(uniform).reshape(bins, 2, self._chirp.chirps, 1)
        for amplitude, (cosine, sine), (g, h) in zip(self._amplitude_s, self._turns, draws, strict=True):
            shift += (amplitude * g) * cosine + (amplitude * h) * sine
        return shift

    def add(self, echoes: Echoes, signal: Float64, seq: int) -> None:
        """Add (df / S) x' to the sum of the echoes, x."""
        slopes = Echoes(
            echoes.range_m,
            echoes.speed_mps,
            echoes.direction_R,
            echoes.amplitude * (echoes.range_m * self._per_m),
            echoes.out_direction_R,
        )
        self._synthesizer.synthesize(slopes, self._both)
        shift = self.shifts_s(seq)
        for k in range(len(self._both) // 2):
            signal[k * self._parts] -= shift * self._both[2 * k + 1]
            if self._parts == 2:
                signal[2 * k + 1] += shift * self._both[2 * k]


def _cos_sin(angle_rad: NDArray[Any]) -> tuple[Float64, Float64]:
    cosine, sine = np.empty(len(angle_rad)), np.empty(len(angle_rad))
    cosines_and_sines(np.ascontiguousarray(angle_rad, np.float64), cosine, sine)
    return cosine, sine
