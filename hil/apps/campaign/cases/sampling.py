"""Points of the unit cube for the sampled axes.

random            Philox streams keyed by seed and name of the axis: more samples or another axis change no value
sobol             scrambled Sobol sequence (Owen scrambling, scipy.stats.qmc): more samples keep the earlier ones
latin_hypercube   one sample in each of n strata of every axis (scipy.stats.qmc): another number draws all anew
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signals.noise import NoiseStream

_BLOCK = 256
MAX_SOBOL_AXES = 64
MAX_HYPERCUBE = 1_000_000

Method = Literal["random", "sobol", "latin_hypercube"]


class UnitSamples:
    """Points in the open unit cube by index, one coordinate for each of `names`."""

    def __init__(self, method: Method, names: Sequence[str], count: int, seed: int) -> None:
        self._method, self._names, self._seed = method, tuple(names), seed
        self._streams = [NoiseStream(seed, f"campaign.{name}") for name in names]
        self._block: tuple[int, NDArray[np.float64]] = (-1, np.empty((0, 0)))
        if method == "latin_hypercube":
            from scipy.stats import qmc  # takes a third of a second

            self._block = 0, qmc.LatinHypercube(d=max(1, len(names)), rng=np.random.default_rng(seed)).random(count)

    def __getitem__(self, index: int) -> NDArray[np.float64]:
        """Return point `index`, shape (axes,)."""
        if self._method == "latin_hypercube":
            return _open(self._block[1][index])
        number, row = divmod(index, _BLOCK)
        if number != self._block[0]:
            self._block = number, self._made(number)
        return _open(self._block[1][row])

    def _made(self, block: int) -> NDArray[np.float64]:
        if self._method == "random":
            columns = [stream.uniform_block(block)[:, 0] for stream in self._streams]
            return np.stack(columns, axis=1) if columns else np.empty((_BLOCK, 0))
        from scipy.stats import qmc

        sequence = qmc.Sobol(d=max(1, len(self._names)), scramble=True, rng=np.random.default_rng(self._seed))
        if block:
            sequence.fast_forward(block * _BLOCK)
        return sequence.random(_BLOCK)


def _open(u: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.clip(u, 2.0**-53, 1.0 - 2.0**-53)
