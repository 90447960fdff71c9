"""Direction of an echo from the phases of the receivers.

Receiver i at r_i (frame R: x forward, y left, z up) measures the phase -2 pi r_i . d / lambda, with d the unit
direction to the echo. A pair (i, j) with the base b = r_i - r_j therefore gives

    b . d = -arg(X_i conj X_j) lambda / (2 pi)   modulo lambda

and d follows from the pairs by least squares, with |d| = 1 and d_x >= 0. Pairs are used in order of the length of b:
the shorter bases determine the multiple of lambda for the next. If all bases lie on a line, the component of d across
this line is taken as zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_atan2
from signals.units import TURN_RAD

_SAME_PLACE = 1e-3  # of a wavelength
_DEEP_ROUNDS = 16  # iterations for bases with an x component, whose equations need d_x of the previous iteration

Float64 = NDArray[np.float64]


class Directions:
    """Receiver array of one radar."""

    def __init__(self, positions_m: Sequence[Sequence[float]], wavelength_m: float) -> None:
        """`positions_m`: x, y, z of each receiver."""
        if not positions_m:
            raise ValueError("an array needs at least one receiver")
        self._receivers = len(positions_m)
        self._wavelength_m = wavelength_m
        r = np.array(positions_m, dtype=np.float64)
        bases = [(i, j, r[i] - r[j]) for i, j in combinations(range(self._receivers), 2)]
        self._rounds = _DEEP_ROUNDS if any(b[0] != 0.0 for _, _, b in bases) else 1
        # Channels in one place, but for the rounding of their sums, tell no direction.
        apart = (_SAME_PLACE * wavelength_m) ** 2
        pairs = (pair for pair in bases if pair[2][1] * pair[2][1] + pair[2][2] * pair[2][2] > apart)
        self._pairs = sorted(pairs, key=lambda pair: float(pair[2] @ pair[2]))

    def find(self, cells: NDArray[np.complex128]) -> Float64:
        """Return unit directions (n, 3) of n cells from the receivers' values (receivers, n)."""
        if len(cells) != self._receivers:
            raise ValueError(f"needs one value per receiver: {self._receivers}, not {len(cells)}")
        n = cells.shape[1]
        along = [self._along(cells[i], cells[j]) for i, j, _ in self._pairs]
        found = np.tile([1.0, 0.0, 0.0], (n, 1))
        for _ in range(self._rounds):
            normal, right, known = np.zeros((2, 2)), np.zeros((n, 2)), np.zeros((n, 2))
            for (_, _, base), target in zip(self._pairs, along, strict=True):
                b = base[1:]
                measured = target - base[0] * found[:, 0]
                # The shorter bases predict the multiple of lambda.
                predicted = known[:, 0] * b[0] + known[:, 1] * b[1] if _spans(normal, b) else 0.0
                measured = measured + self._wavelength_m * np.floor((predicted - measured) / self._wavelength_m + 0.5)
                normal = normal + np.outer(b, b)
                right = right + measured[:, None] * b
                known = _solved(normal, right)
            across = np.sqrt(known[:, 0] * known[:, 0] + known[:, 1] * known[:, 1])
            known = known / np.maximum(across, 1.0)[:, None]  # noise may give more than 1: use the nearest direction
            found[:, 1:] = known
            found[:, 0] = np.sqrt(np.maximum(1.0 - known[:, 0] * known[:, 0] - known[:, 1] * known[:, 1], 0.0))
        return found

    def _along(self, x_i: NDArray[np.complex128], x_j: NDArray[np.complex128]) -> Float64:
        """Return b . d of a pair, modulo lambda; in real numbers, since numpy's complex product depends on the CPU."""
        re = x_i.real * x_j.real + x_i.imag * x_j.imag
        im = x_i.imag * x_j.real - x_i.real * x_j.imag
        turns = np.array([det_atan2(y, x) for y, x in zip(im.tolist(), re.tolist(), strict=True)]) / TURN_RAD
        return -turns * self._wavelength_m


def _spans_plane(normal: Float64) -> bool:
    """Return True if the bases span a plane."""
    size = normal[0, 0] + normal[1, 1]
    return bool(normal[0, 0] * normal[1, 1] - normal[0, 1] * normal[0, 1] > 1e-6 * size * size)


def _spans(normal: Float64, b: Float64) -> bool:
    """Return True if the bases summed in `normal` determine d . b."""
    if _spans_plane(normal):
        return True
    size = normal[0, 0] + normal[1, 1]
    off = b[0] * b[0] * normal[1, 1] - 2.0 * b[0] * b[1] * normal[0, 1] + b[1] * b[1] * normal[0, 0]
    return bool(off < 1e-6 * (b[0] * b[0] + b[1] * b[1]) * size)  # squared, across the line


def _solved(normal: Float64, right: Float64) -> Float64:
    """Return (y, z) by least squares; for bases on a line, the shortest solution."""
    (yy, yz), (_, zz) = normal
    if not _spans_plane(normal):
        return right / (yy + zz)
    y, z = zz * right[:, 0] - yz * right[:, 1], yy * right[:, 1] - yz * right[:, 0]
    return np.stack([y, z], axis=1) / (yy * zz - yz * yz)
