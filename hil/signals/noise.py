"""Named, counter-based noise streams.

A draw is a pure function of (seed, stream name, sample index, lane): Philox4x64-10 (Salmon et al., "Parallel
random numbers: as easy as 1, 2, 3", SC 2011) gives 64 uniform bits, and the inverse normal distribution function
(Wichura, algorithm AS 241, Applied Statistics 37, 1988; relative accuracy about 1e-16) turns them into a normal.
So adding, skipping or reordering one sensor never changes another's noise, and sample 10,000 can be had without
the 9,999 before it.

numpy's own `Generator.normal` is not used: its ziggurat calls the C library's exp and log1p, whose last bit
depends on the CPU. Here only + - * / sqrt, comparisons and integer operations touch the numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_BLOCK = 256  # samples prepared at once; changes speed only, never values

_LN2_HI = 6.93147180369123816490e-01
_LN2_LO = 1.90821492927058770002e-10


def _poly(coefficients: Sequence[float], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Horner's rule, highest power first."""
    result = np.full_like(x, coefficients[0])
    for c in coefficients[1:]:
        result = result * x + c
    return result


def _log(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Natural logarithm of positive normal doubles, < 2 ulp, from exactly rounded operations only.

    x = m 2^k with m in [sqrt(1/2), sqrt(2)); log m = 2 atanh(s), s = (m-1)/(m+1), by its series in s^2.
    """
    m, k = np.frexp(x)
    low = m < 0.70710678118654752440
    m = np.where(low, m * 2.0, m)
    k = np.where(low, k - 1, k).astype(np.float64)
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    series = _poly([1.0 / n for n in range(23, 2, -2)], z) * z
    return k * _LN2_HI + (2.0 * s * (1.0 + series) + k * _LN2_LO)


# AS 241, routine PPND16. Highest power first.
_A = (2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
      13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608)  # fmt: skip
_B = (5226.495278852854561, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
      5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0)  # fmt: skip
_C = (7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177, 1.27045825245236838258,
      3.64784832476320460504, 5.7694972214606914055, 4.6303378461565452959, 1.42343711074968357734)  # fmt: skip
_D = (1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966, 0.14810397642748007459,
      0.68976733498510000455, 1.6763848301838038494, 2.05319162663775882187, 1.0)  # fmt: skip
_E = (2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386, 0.026532189526576123093,
      0.29656057182850489123, 1.7848265399172913358, 5.4637849111641143699, 6.6579046435011037772)  # fmt: skip
_F = (2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5, 7.868691311456132591e-4,
      0.0148753612908506148525, 0.13692988092273580531, 0.59983220655588793769, 1.0)  # fmt: skip


def normal_from_uniform(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse of the standard normal distribution function, elementwise, for 0 < p < 1 (AS 241)."""
    q = p - 0.5
    r_mid = 0.180625 - q * q
    middle = q * (_poly(_A, r_mid) / _poly(_B, r_mid))
    outer = np.abs(q) > 0.425
    if not outer.any():
        return middle
    tail = np.where(q < 0.0, p, 1.0 - p)
    r = np.sqrt(-_log(np.where(outer, tail, 0.5)))
    near = r - 1.6
    far = r - 5.0
    value = np.where(r <= 5.0, _poly(_C, near) / _poly(_D, near), _poly(_E, far) / _poly(_F, far))
    return np.where(outer, np.where(q < 0.0, -value, value), middle)


class NoiseStream:
    """Standard normal (or uniform) draws of one named source of noise.

    `lanes` is the number of independent draws per sample index (3 for a vector sensor). Draws are pure functions
    of (seed, name, index, lane). Reading indices in order is fast; any order gives the same values.
    """

    def __init__(self, seed: int, name: str, *, lanes: int = 1) -> None:
        if lanes < 1:
            raise ValueError("a noise stream needs at least one lane")
        digest = hashlib.blake2b(f"{seed}\x00{name}".encode(), digest_size=16).digest()
        self._key = np.frombuffer(digest, dtype="<u8").astype(np.uint64)
        self.name = name
        self.lanes = lanes
        self._block_index = -1
        self._block: list[tuple[float, ...]] = []

    def uniform_block(self, block: int) -> NDArray[np.float64]:
        """Uniforms on (0, 1) of samples [block*256, (block+1)*256), shape (256, lanes)."""
        # Counter word 2 holds the block, words 0-1 run within it: blocks never overlap.
        bits = np.random.Philox(key=self._key, counter=[0, 0, block, 0]).random_raw(_BLOCK * self.lanes)
        # 52 bits and half a step: never 0, never 1, and 1 - p is exact.
        return (((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52).reshape(_BLOCK, self.lanes)

    def normal_block(self, block: int) -> NDArray[np.float64]:
        """Standard normals of samples [block*256, (block+1)*256), shape (256, lanes)."""
        return normal_from_uniform(self.uniform_block(block))

    def normal(self, index: int) -> tuple[float, ...]:
        """The `lanes` standard normals of sample `index` (>= 0)."""
        block, offset = divmod(index, _BLOCK)
        if block != self._block_index:
            self._block = [tuple(row) for row in self.normal_block(block).tolist()]
            self._block_index = block
        return self._block[offset]
