"""Speed of a track, as a density over all speeds that the radar tells apart.

A body is many scatterers whose echoes interfere: the trunk of a walker fades for a frame or two, or its peak splits in
two, and then a limb is the strongest peak. One frame cannot tell which peak is the trunk. Several frames can, because
the trunk is the strongest echo on average and changes its speed slowly, while a limb passes it. A mean and a deviation
would follow the limb as soon as the trunk fades; the density keeps both until the frames have decided:

    between frames    p(v) <- sum_u p(v - u) / (1 + (u / (a dt))^2)              Cauchy steps: mostly small ones
    at a frame        p(v) <- p(v) (e P + sum_i P_i / (1 + (v - v_i)^2 / w^2)^2)

with a the usual acceleration, P_i and v_i the power over noise and the speed of the points, w the width of a peak, and
P the recent mean of sum_i P_i: a frame in which the body fades says little. e P stands for the echoes of the trunk that
are not peaks of their own. Speeds are modulo 2 v_max, as the radar measures them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import Chirp

_UNSEEN_SHARE = 0.03  # e
_POWER_MEMORY_S = 0.5  # of P
# The estimate is the mean this far about the most likely speed, which alone would jump between cells.
_ABOUT_MODE_MPS = 0.5

Float64 = NDArray[np.float64]


class TrunkSpeed:
    """Density of a track's speed in cells of half the resolution, and its mean about the most likely speed."""

    def __init__(self, chirp: Chirp, speed_mps: float, *, sigma_mps: float) -> None:
        """`sigma_mps`: deviation of one point's speed from that of the trunk."""
        cells = 2 * chirp.chirps
        self._step_mps = 2.0 * chirp.max_speed_mps / cells
        # Of the cells, from `_middle_mps`.
        self._offset_mps = np.linspace(-chirp.max_speed_mps, chirp.max_speed_mps, cells, endpoint=False)
        self._width_mps = max(chirp.speed_resolution_mps, 0.5 * sigma_mps)
        self._middle_mps = speed_mps
        self._density = _peak(self._offset_mps / sigma_mps)
        self._mean_power: float | None = None
        self._new_share = 1.0  # of the next frame in the mean power
        self.mean_mps = speed_mps

    def predict(self, dt_s: float, acceleration_mps2: float) -> None:
        """Widen the density by `dt_s` of acceleration."""
        step = 1.0 / (1.0 + np.square(self._offset_mps / max(acceleration_mps2 * dt_s, 1e-3 * self._step_mps)))
        self._new_share = dt_s / (_POWER_MEMORY_S + dt_s)
        spectrum = np.fft.rfft(self._density) * np.fft.rfft(np.fft.ifftshift(step / step.sum()))
        self._density = np.maximum(np.fft.irfft(spectrum, len(step)), 0.0)

    def update(self, speed_mps: Float64, power: Float64) -> None:
        """Update the density and its mean with the points of a frame: speeds modulo 2 v_max, power over noise."""
        total = float(power.sum())
        before = total if self._mean_power is None else self._mean_power
        off = self._folded(self._offset_mps[:, None] - (speed_mps - self._middle_mps)) / self._width_mps
        self._density *= _UNSEEN_SHARE * before + (_peak(off) * power).sum(axis=1)
        self._density /= self._density.sum()
        self._mean_power = before + self._new_share * (total - before)
        mode = int(np.argmax(self._density))
        # The mode becomes the middle, so that a speed beyond v_max goes on from there.
        self._middle_mps += float(self._offset_mps[mode])
        self._density = np.roll(self._density, len(self._offset_mps) // 2 - mode)
        weight = self._density * (np.abs(self._offset_mps) <= _ABOUT_MODE_MPS)
        self.mean_mps = self._middle_mps + float((weight * self._offset_mps).sum() / weight.sum())

    def _folded(self, speed_mps: Float64) -> Float64:
        whole = self._step_mps * len(self._offset_mps)
        folded: Float64 = speed_mps - whole * np.floor(speed_mps / whole + 0.5)
        return folded


def _peak(off: Float64) -> Float64:
    """Return a peak of height and deviation 1."""
    peak: Float64 = 1.0 / np.square(1.0 + np.square(off))
    return peak
