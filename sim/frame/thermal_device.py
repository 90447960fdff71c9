"""Noise and counts of a thermal camera.

The noise-equivalent temperature difference (NETD) is the deviation in time of a pixel that sees a black body of 300
K. The noise belongs to the radiance, so that a cold sky, where light changes little with temperature, is noisier in
kelvins:

    L' = L(T) + NETD (dL/dT at 300 K) n,   counts = round((T(L') - zero_k) counts_per_k),  limited to `bits`

n is a standard normal of the picture's number and the pixel alone. Fixed patterns and drift between two shutters are
not modelled.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.noise import normal_from_uniform, uniform_from_bits
from sim.frame.band_radiance import band_radiance, radiance_of, temperature_of

_REFERENCE_K, _HALF_K = 300.0, 0.5


class ThermalDevice:
    """Output of one thermal camera."""

    def __init__(self, parameters: Any, key: tuple[int, int]) -> None:
        """`parameters`: sim.sensors.camera_parameters.Infrared."""
        slope = band_radiance(_REFERENCE_K + _HALF_K) - band_radiance(_REFERENCE_K - _HALF_K)
        self._sigma = parameters.netd_k * slope
        self._zero_k, self._per_k = parameters.zero_k, parameters.counts_per_k
        self._most = float((1 << parameters.bits) - 1)
        self._key = np.array(key, np.uint64)

    def measure(self, temperature_k: NDArray[np.float32], index: int, counts: NDArray[np.uint16]) -> None:
        """Write the counts of picture number `index`."""
        measured_k = temperature_k.astype(np.float64)
        if self._sigma > 0.0:
            bits = np.random.Philox(key=self._key, counter=[0, 0, index, 0]).random_raw(measured_k.size)
            u = uniform_from_bits(bits)
            noise = normal_from_uniform(u).reshape(measured_k.shape)
            measured_k = temperature_of(radiance_of(measured_k) + self._sigma * noise)
        rounded = np.floor((measured_k - self._zero_k) * self._per_k + 0.5)
        counts[:] = np.minimum(np.maximum(rounded, 0.0), self._most).astype(np.uint16)
