"""Slow sensor errors as first-order processes over the sample index of a sensor."""

from __future__ import annotations

import math

from signals._kernel import det_exp
from signals.noise import NoiseStream
from signals.time import NS_PER_S
from sim.sensors.sensor import Installation


class Drift:
    """Independent first-order processes, one per lane, stepped once per sample:

        x_0     = start * n_0
        x_{k+1} = phi x_k + step * n_{k+1}

    A value is a function of (seed, name, index) alone, so skipped samples change nothing. `at` steps from the last
    index to the new one; for a lower index it starts again at 0.
    """

    def __init__(self, seed: int, name: str, *, lanes: int, start: float, phi: float, step: float) -> None:
        self._noise = NoiseStream(seed, name, lanes=lanes)
        self._start, self._phi, self._step = start, phi, step
        self._index = -1
        self._value: tuple[float, ...] = (0.0,) * lanes

    def at(self, index: int) -> tuple[float, ...]:
        """Return the values at sample `index` (>= 0)."""
        if index == self._index:
            return self._value
        if index < self._index:
            self._index = -1
        if self._index < 0:
            start = self._start
            self._value = tuple([start * n for n in self._noise.normal(0)])
            self._index = 0
        phi, step, normal = self._phi, self._step, self._noise.normal
        while self._index < index:
            self._index += 1
            self._value = tuple([phi * x + step * n for x, n in zip(self._value, normal(self._index), strict=True)])
        return self._value


def gauss_markov(installation: Installation, *, lanes: int, sigma: float, time_constant_s: float) -> Drift:
    """Return a stationary process of standard deviation `sigma` and correlation e^{-t / time_constant}."""
    phi = det_exp(-installation.period_ns / NS_PER_S / time_constant_s)
    name = f"{installation.name}.drift"
    return Drift(installation.seed, name, lanes=lanes, start=sigma, phi=phi, step=sigma * math.sqrt(1.0 - phi * phi))
