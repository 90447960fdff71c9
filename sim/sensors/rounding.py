"""Rounding of a sensor's output, one rule for every sensor.

A stated noise is that of the output, so the rounding error of the output word is part of it: the drawn noise has the
variance sigma^2 - q^2 / 12, with q the step of the word. Averaged over the true value within a step, the error of the
output then has exactly the variance sigma^2. Where the step alone has more (q > 3.46 sigma), nothing is drawn.
Gaussian noise of cameras and radars is added before their converter instead, as in the device.
"""

from __future__ import annotations

import math


def drawn_sigma(stated: float, step: float) -> float:
    """Return the deviation of the noise before rounding to `step` that gives the output the stated deviation."""
    return math.sqrt(max(0.0, stated * stated - step * step / 12.0))


def noise_with_rounding(drawn: float, step: float) -> float:
    """Return the deviation of a rounded output to which noise of the deviation `drawn` was added."""
    return math.hypot(drawn, step / math.sqrt(12.0))


def rounded(value: float, step: float) -> float:
    """Return the nearest multiple of `step`."""
    return math.floor(value / step + 0.5) * step


def saturated(value: float, step: float, limit: float) -> float:
    """Return the nearest multiple of `step`, saturated at -limit and limit - step, as in a two's-complement word."""
    return min(max(rounded(value, step), -limit), limit - step)
