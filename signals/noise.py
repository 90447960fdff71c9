"""Named, counter-based noise streams.

A draw is a pure function of (seed, stream name, sample index, lane): Philox4x64-10 (Salmon et al., "Parallel
random numbers: as easy as 1, 2, 3", SC 2011) gives 64 uniform bits, and the inverse normal distribution function
(Wichura, algorithm AS 241, Applied Statistics 37, 1988; relative accuracy about 1e-16) turns them into a normal number.
Adding, skipping or reordering one sensor therefore never changes the noise of another, and sample 10,000 can be drawn
without the 9,999 before it.

numpy's own `Generator.normal` is not used: its ziggurat calls the C library's exp and log1p, whose last bit
depends on the CPU. The native generator (native/noise_stream.hpp) uses only + - * / sqrt, comparisons and integer
operations; kernels that draw noise themselves use the same generator with `noise_key`.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from signals._kernel import NoiseGenerator, det_log, normals_from_uniforms

_BLOCK = 256  # samples of one block of the counter; part of the definition of a draw


def noise_key(seed: int, name: str) -> tuple[int, int]:
    """Return the two key words of the stream with this seed and name."""
    digest = hashlib.blake2b(f"{seed}\x00{name}".encode(), digest_size=16).digest()
    return int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:], "little")


def normal_from_uniform(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal quantiles of p, elementwise, for 0 < p < 1 (AS 241)."""
    out = np.empty(p.size)
    normals_from_uniforms(np.ascontiguousarray(p, np.float64).ravel(), out)
    return out.reshape(p.shape)


def uniform_from_bits(bits: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return uniforms on (0, 1), elementwise: 52 bits and half a step, so never 0, never 1, and 1 - p is exact."""
    return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def exponential_nodes(count: int) -> NDArray[np.float64]:
    """Return -ln u at the middles of `count` equal intervals of (0, 1): draws of an exponential of mean 1."""
    return np.array([-det_log((k + 0.5) / count) for k in range(count)])


class NoiseStream:
    """Stream of standard normal (or uniform) draws of one named source of noise.

    `lanes` is the number of independent draws per sample index (3 for a vector sensor). Draws are pure functions
    of (seed, name, index, lane). Reading indices in order is fast; any order gives the same values.
    """

    def __init__(self, seed: int, name: str, *, lanes: int = 1) -> None:
        self._key = noise_key(seed, name)
        self.name = name
        self.lanes = lanes
        self._generator = NoiseGenerator(self._key, lanes)
        self.normal = self._generator.normal  # (index >= 0) -> the `lanes` standard normals of that sample

    def uniform_block(self, block: int) -> NDArray[np.float64]:
        """Return the uniforms on (0, 1) of samples [block*256, (block+1)*256), shape (256, lanes)."""
        # Counter word 2 is the block and words 0-1 count within the block, so blocks never overlap.
        key = np.array(self._key, np.uint64)
        bits = np.random.Philox(key=key, counter=[0, 0, block, 0]).random_raw(_BLOCK * self.lanes)
        return uniform_from_bits(bits).reshape(_BLOCK, self.lanes)

    def normal_block(self, block: int) -> NDArray[np.float64]:
        """Return the standard normals of samples [block*256, (block+1)*256), shape (256, lanes)."""
        return normal_from_uniform(self.uniform_block(block))
