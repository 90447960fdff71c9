"""Wall-clock statistics of a run: bounded memory, cheap enough for every tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_MAX_NS = 2**63 - 1
_SUB_BITS = 5  # 32 bins per factor of two: a quantile is within 1/32 = 3 % of the true value


class LatencyHistogram:
    """Histogram of durations in logarithmic bins; gives quantiles without storing samples.

    A duration d [ns] with its highest bit at position b falls in the bin of its top 6 bits, so bins are at most
    3.2 % wide; below 64 ns bins are exact.
    """

    __slots__ = ("_bins", "count", "max_ns", "total_ns")

    def __init__(self) -> None:
        self._bins = [0] * ((64 - _SUB_BITS) << _SUB_BITS)
        self.count = 0
        self.total_ns = 0
        self.max_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration, limited to 0 .. 2^63 - 1; it is negative if the clock was set back."""
        if duration_ns < 0:
            duration_ns = 0
        elif duration_ns > _MAX_NS:
            duration_ns = _MAX_NS
        shift = duration_ns.bit_length() - 1 - _SUB_BITS
        if shift > 0:
            self._bins[(shift << _SUB_BITS) + (duration_ns >> shift)] += 1
        else:
            self._bins[duration_ns] += 1
        self.count += 1
        self.total_ns += duration_ns
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns

    def add_all(self, durations_ns: Sequence[int] | NDArray[np.int64]) -> None:
        """Count durations as `add` does, each below 2^63; many at a time take a fifth of its time."""
        if not len(durations_ns):
            return
        counted_ns = np.maximum(np.asarray(durations_ns, np.int64), 0)
        # A float's exponent is the position of the highest bit. Above 2^53, where it may be rounded up, the bin is the
        # same: the last one of a factor of two is also the last but one of the next.
        shifts = np.maximum(np.frexp(counted_ns)[1] - 1 - _SUB_BITS, 0)
        indices, counts = np.unique((shifts << _SUB_BITS) + (counted_ns >> shifts), return_counts=True)
        for index, n in zip(indices.tolist(), counts.tolist(), strict=True):
            self._bins[index] += n
        self.count += len(durations_ns)
        self.total_ns += sum(counted_ns.tolist())
        self.max_ns = max(self.max_ns, int(counted_ns.max()))

    def quantile_ns(self, q: float) -> float:
        """Return the q-quantile (0..1) as the middle of its bin; 0 before the first duration."""
        if self.count == 0:
            return 0.0
        rank = q * (self.count - 1)
        seen = 0
        for index, n in enumerate(self._bins):
            seen += n
            if n and seen > rank:
                return min(_bin_middle(index), float(self.max_ns))
        return float(self.max_ns)

    def bins(self) -> list[tuple[float, int]]:
        """Return (middle of the bin [ns], count) of every bin that is not empty, in rising order."""
        return [(_bin_middle(i), n) for i, n in enumerate(self._bins) if n]

    @property
    def mean_ns(self) -> float:
        return self.total_ns / self.count if self.count else 0.0


def _bin_middle(index: int) -> float:
    if index < (2 << _SUB_BITS):
        return float(index)
    shift = (index >> _SUB_BITS) - 1
    low = (index - (shift << _SUB_BITS)) << shift
    return low + 0.5 * (1 << shift)
