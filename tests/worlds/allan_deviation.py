"""Allan deviation: the datasheet line, the exact value of a sampled process, and the overlapping estimate.

line        sigma^2(tau) = N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3                                (IEEE Std 952-1997)
sampled     a value is the mean of m samples, so tau = m dt:
  white     s^2/m
  walk      K^2 dt (2 m^2 + 1) / (6 m)          sum of steps K sqrt(dt)
  AR(1)     s^2 [(m + 2 sum_{j<m} (m - j) phi^j) - phi ((1 - phi^m)/(1 - phi))^2] / m^2
overlapping sigma^2 = 1/(2 m^2 (n - 2m + 1)) sum_j (S_{j+2m} - 2 S_{j+m} + S_j)^2,  S the running sum
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def line(n: float, b: float, k: float, tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Allan deviation of the datasheet."""
    return np.sqrt(n * n / tau_s + 2.0 * math.log(2.0) / math.pi * b * b + k * k * tau_s / 3.0)


def white_variance(sigma: float, m: NDArray[np.float64]) -> NDArray[np.float64]:
    return sigma * sigma / m


def walk_variance(step: float, m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of a random walk; `step` is the deviation of one step."""
    return step * step * (2.0 * m * m + 1.0) / (6.0 * m)


def markov_variance(sigma: float, phi: float, m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The double sum in closed form: sum_{j=1}^{m-1} (m - j) phi^j = phi (m (1 - phi) - (1 - phi^m)) / (1 - phi)^2."""
    one_less = -math.expm1(math.log(phi))  # 1 - phi without cancellation
    rest = -np.expm1(m * math.log(phi))  # 1 - phi^m
    own = m + 2.0 * phi * (m * one_less - rest) / one_less**2
    return sigma * sigma * (own - phi * (rest / one_less) ** 2) / (m * m)


def running_sum(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(values - values.mean())])


def overlapping_of_sum(s: NDArray[np.float64], m: int) -> float:
    """Overlapping Allan deviation over m samples from every (m/16)-th running sum: closer ones add nothing."""
    stride = max(1, m // 16)
    d = s[2 * m :: stride] - 2.0 * s[m:-m:stride] + s[: -2 * m : stride]
    return math.sqrt(float(np.mean(d * d)) / 2.0) / m


def freedom(count: int, m: int) -> float:
    """Lower bound of the degrees of freedom of `overlapping`: those of independent differences of 2m samples, and
    half as many again for the overlap (Riley, NIST SP 1065, table 5: 1.4 to 3 times for white to random-walk noise)."""
    return max(1.0, 1.4 * (count / (2.0 * m) - 1.0)) if m > 1 else count / 2.0


def spread(count: int, m: int) -> float:
    """Return the relative standard deviation of the estimate of the deviation."""
    return 1.0 / math.sqrt(2.0 * freedom(count, m))


def octaves(low: float, high: float, per_decade: int = 6) -> Sequence[float]:
    """Logarithmic grid with both ends."""
    return list(np.geomspace(low, high, round(per_decade * math.log10(high / low)) + 1))
