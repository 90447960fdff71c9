"""A path of polynomials of 7th order, one per segment, and its value at any time."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np

from hil_companion.cuts.fixed_order import power, product

COEFFICIENTS = 8
SAMPLES = 64  # per segment, for peaks and distances


def derivative_row(s: float, k: int) -> np.ndarray:
    """Return the row r (8,) with r c = the k-th derivative of c_0 + c_1 s + ... + c_7 s^7 at s."""
    row = np.zeros(COEFFICIENTS)
    for i in range(k, COEFFICIENTS):
        row[i] = factorial(i) / factorial(i - k) * power(s, i - k)
    return row


class PathPoint(NamedTuple):
    """Position, velocity and acceleration at one time, in W."""

    p_W: np.ndarray
    v_W: np.ndarray
    a_W: np.ndarray


class SnapPath:
    """Consecutive segments: `coefficients[i, :, axis]` of segment i, in s = time within the segment / its duration."""

    def __init__(self, durations_s: np.ndarray, coefficients: np.ndarray) -> None:
        self.durations_s = np.asarray(durations_s, float)
        self.coefficients = np.asarray(coefficients, float)
        self.ends_s = np.cumsum(self.durations_s)

    @property
    def duration_s(self) -> float:
        return float(self.ends_s[-1])

    def derivative(self, segment: int, s: float, k: int) -> np.ndarray:
        """Return the k-th time derivative of one segment at s."""
        value = product(derivative_row(s, k)[None], self.coefficients[segment])[0]
        return np.asarray(value / power(self.durations_s[segment], k))

    def at(self, t_s: float) -> PathPoint:
        """Return the point at a time; before its start and after its end the path rests."""
        t_s = min(max(t_s, 0.0), self.duration_s)
        segment = min(int(np.searchsorted(self.ends_s, t_s, side="right")), len(self.durations_s) - 1)
        began_s = self.ends_s[segment] - self.durations_s[segment]
        s = min(max((t_s - began_s) / self.durations_s[segment], 0.0), 1.0)
        return PathPoint(*(self.derivative(segment, s, k) for k in range(3)))

    def sampled(self, k: int) -> np.ndarray:
        """Return the k-th derivative at SAMPLES + 1 points of each segment: (segments, SAMPLES + 1, 3)."""
        rows = np.array([derivative_row(s, k) for s in np.linspace(0.0, 1.0, SAMPLES + 1)])
        by_s = np.array([product(rows, coefficients) for coefficients in self.coefficients])
        return by_s / np.array([power(duration_s, k) for duration_s in self.durations_s])[:, None, None]

    def stretched(self, factor: float) -> SnapPath:
        """Return the path in `factor` times the time: v / factor, a / factor^2. A minimum-snap path stays one."""
        return SnapPath(self.durations_s * factor, self.coefficients)

    def followed_by(self, other: SnapPath) -> SnapPath:
        return SnapPath(
            np.concatenate([self.durations_s, other.durations_s]),
            np.concatenate([self.coefficients, other.coefficients]),
        )


def snap_weights() -> np.ndarray:
    """Return Q (8, 8) with c' Q c = the integral over s in 0..1 of the squared 4th derivative."""
    q = np.zeros((COEFFICIENTS, COEFFICIENTS))
    for i in range(4, COEFFICIENTS):
        for j in range(4, COEFFICIENTS):
            q[i, j] = factorial(i) / factorial(i - 4) * factorial(j) / factorial(j - 4) / (i + j - 7)
    return q
