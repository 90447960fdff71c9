"""Leakage of a radar over a sweep: recorded with one chirp, computed for another.

Leakage from transmitter to receiver, and static objects close by, mix down to a voltage u(f) that is a function of the
instantaneous RF frequency f alone. The high-pass after the mixer passes only the change of u during the sweep, and its
charge from before the sweep decays (turn-on). Sample by sample, with T = 1 / f_s:

    y[0] = s        y[n] = a y[n-1] + g (u[n] - u[n-1])        a = exp(-2 pi f_hp T)     g = (1 - a) / (2 pi f_hp T)

(exact if u is linear between samples). A recording gives y; s and u(f) follow from y, up to a constant that affects no
output. Another chirp samples u at its own frequencies (Catmull-Rom between the recorded frequencies) and applies the
high-pass at its own sample rate. So a narrower sweep, over which u changes more slowly, leaks less, but has the same
turn-on. The recorded chirp gives the recorded counts unchanged. Without a high-pass y = u.

Determinism: + - * / on Python floats in a fixed order, and `det_exp`.
"""

from __future__ import annotations

from math import floor, pi
from typing import Annotated

from pydantic import Field, model_validator

from signals._kernel import det_exp
from signals.documents.validate import StrictModel
from sim.radar.chirp import Chirp

_Frequency = Annotated[float, Field(gt=0.0, le=1e12)]
_Count = Annotated[float, Field(ge=-65536.0, le=65536.0)]
_Row = Annotated[tuple[_Count, ...], Field(min_length=8, max_length=1024)]

_SAME = 1e-9  # relative difference below which two frequencies are equal


class SweptPattern(StrictModel):
    """Recorded leakage `counts[k][n]` of receiver k at the frequency start_frequency_hz + n bandwidth_hz / samples."""

    start_frequency_hz: _Frequency
    bandwidth_hz: _Frequency
    sample_rate_hz: _Frequency
    hp_cutoff_hz: _Frequency | None
    counts: Annotated[tuple[_Row, ...], Field(min_length=1, max_length=64)]

    @model_validator(mode="after")
    def _rows_alike(self) -> SweptPattern:
        lengths = sorted({len(row) for row in self.counts})
        if len(lengths) > 1:
            raise ValueError(f"counts must have the same length for every receiver, not {lengths}")
        return self

    @property
    def receivers(self) -> int:
        return len(self.counts)

    @property
    def end_frequency_hz(self) -> float:
        return self.start_frequency_hz + self.bandwidth_hz

    def problem_with(self, chirp: Chirp) -> str:
        """Return why the pattern does not cover `chirp`; "" if it does."""
        slack = _SAME * self.end_frequency_hz
        first, last = chirp.start_frequency_hz, chirp.start_frequency_hz + chirp.bandwidth_hz
        if first >= self.start_frequency_hz - slack and last <= self.end_frequency_hz + slack:
            return ""
        return (
            f"was recorded from {self.start_frequency_hz / 1e9:g} to {self.end_frequency_hz / 1e9:g} GHz and does not "
            f"cover a sweep from {first / 1e9:g} to {last / 1e9:g} GHz"
        )

    def at(self, chirp: Chirp) -> list[list[float]]:
        """Return the counts per receiver at the samples of `chirp`. Raises ValueError outside the recorded band."""
        problem = self.problem_with(chirp)
        if problem:
            raise ValueError(f"the pattern {problem}")
        return [self._row_at(row, chirp) for row in self.counts]

    def _row_at(self, counts: tuple[float, ...], chirp: Chirp) -> list[float]:
        if self._is_of(chirp):
            return list(counts)
        voltage = self._before_high_pass(counts)
        step_hz = self.bandwidth_hz / len(counts)
        first = (chirp.start_frequency_hz - self.start_frequency_hz) / step_hz
        step = chirp.bandwidth_hz / chirp.samples / step_hz
        swept = [_catmull_rom(voltage, first + n * step) for n in range(chirp.samples)]
        if self.hp_cutoff_hz is None:
            return swept
        a, g = _high_pass(self.hp_cutoff_hz, chirp.sample_rate_hz)
        y = [counts[0]]
        for n in range(1, chirp.samples):
            y.append(a * y[-1] + g * (swept[n] - swept[n - 1]))
        return y

    def _is_of(self, chirp: Chirp) -> bool:
        def same(p: float, q: float) -> bool:
            return abs(p - q) <= _SAME * abs(q)

        return (
            len(self.counts[0]) == chirp.samples
            and same(chirp.start_frequency_hz, self.start_frequency_hz)
            and same(chirp.bandwidth_hz, self.bandwidth_hz)
            and same(chirp.sample_rate_hz, self.sample_rate_hz)
        )

    def _before_high_pass(self, counts: tuple[float, ...]) -> list[float]:
        if self.hp_cutoff_hz is None:
            return list(counts)
        a, g = _high_pass(self.hp_cutoff_hz, self.sample_rate_hz)
        u = [0.0]
        for n in range(1, len(counts)):
            u.append(u[-1] + (counts[n] - a * counts[n - 1]) / g)
        return u


def _high_pass(cutoff_hz: float, rate_hz: float) -> tuple[float, float]:
    """Return the decay of a voltage over one sample, and the response to a ramp of one count per sample."""
    x = 2.0 * pi * cutoff_hz / rate_hz
    a = det_exp(-x)
    return a, (1.0 - a) / x


def _catmull_rom(values: list[float], position: float) -> float:
    """Return the cubic through `values` (at 0, 1, ...) at `position`; linear beyond the ends, at most one step."""
    last = len(values) - 1
    i = min(max(floor(position), 0), last - 1)
    t = position - i
    p1, p2 = values[i], values[i + 1]
    p0 = values[i - 1] if i > 0 else 2.0 * p1 - p2
    p3 = values[i + 2] if i + 2 <= last else 2.0 * p2 - p1
    if not 0.0 <= t <= 1.0:
        return p1 + t * (p2 - p1)
    return p1 + 0.5 * t * ((p2 - p0) + t * ((2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) + t * (3.0 * (p1 - p2) + p3 - p0)))
