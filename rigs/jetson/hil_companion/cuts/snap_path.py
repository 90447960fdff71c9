"""A path of polynomials of 7th order, one per segment, and what it is at any time."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np

COEFFICIENTS = 8
SAMPLES = 64  # per segment, where peaks and distances are looked for


def derivative_row(s: float, k: int) -> np.ndarray:
    """What the k-th derivative at s of c_0 + c_1 s + ... + c_7 s^7 is, as a row to be multiplied by c."""
    row = np.zeros(COEFFICIENTS)
    for i in range(k, COEFFICIENTS):
        row[i] = factorial(i) / factorial(i - k) * s ** (i - k)
    return row


class PathPoint(NamedTuple):
    """Where the path is at one time, in W."""

    p_W: np.ndarray
    v_W: np.ndarray
    a_W: np.ndarray


class SnapPath:
    """Segments one behind the other. `coefficients[i, :, axis]` are in s = time within the segment / its duration."""

    def __init__(self, durations_s: np.ndarray, coefficients: np.ndarray) -> None:
        self.durations_s = np.asarray(durations_s, float)
        self.coefficients = np.asarray(coefficients, float)
        self.ends_s = np.cumsum(self.durations_s)

    @property
    def duration_s(self) -> float:
        return float(self.ends_s[-1])

    def derivative(self, segment: int, s: float, k: int) -> np.ndarray:
        """The k-th derivative by time at s of one segment."""
        value: np.ndarray = derivative_row(s, k) @ self.coefficients[segment] / self.durations_s[segment] ** k
        return value

    def at(self, t_s: float) -> PathPoint:
        """Before its beginning and after its end the path rests."""
        t_s = min(max(t_s, 0.0), self.duration_s)
        segment = min(int(np.searchsorted(self.ends_s, t_s, side="right")), len(self.durations_s) - 1)
        began_s = self.ends_s[segment] - self.durations_s[segment]
        s = min(max((t_s - began_s) / self.durations_s[segment], 0.0), 1.0)
        return PathPoint(*(self.derivative(segment, s, k) for k in range(3)))

    def sampled(self, k: int) -> np.ndarray:
        """The k-th derivative at SAMPLES + 1 places of each segment: (segments, SAMPLES + 1, 3)."""
        rows = np.array([derivative_row(s, k) for s in np.linspace(0.0, 1.0, SAMPLES + 1)])
        by_s = np.einsum("sc,ica->isa", rows, self.coefficients)
        by_time: np.ndarray = by_s / self.durations_s[:, None, None] ** k
        return by_time

    def stretched(self, factor: float) -> SnapPath:
        """The same way in `factor` times the time: v / factor, a / factor^2; what was of least snap stays so."""
        return SnapPath(self.durations_s * factor, self.coefficients)

    def followed_by(self, other: SnapPath) -> SnapPath:
        return SnapPath(
            np.concatenate([self.durations_s, other.durations_s]),
            np.concatenate([self.coefficients, other.coefficients]),
        )


def snap_weights() -> np.ndarray:
    """Q with c' Q c = the integral over s in 0..1 of the squared 4th derivative."""
    q = np.zeros((COEFFICIENTS, COEFFICIENTS))
    for i in range(4, COEFFICIENTS):
        for j in range(4, COEFFICIENTS):
            q[i, j] = factorial(i) / factorial(i - 4) * factorial(j) / factorial(j - 4) / (i + j - 7)
    return q
