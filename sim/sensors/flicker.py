"""Bias instability (flicker, 1/f noise) as a sum of first-order processes.

A process of variance s^2 and time constant T has the Allan variance (u = tau / T)

    s^2 (2u - 3 + 4 e^-u - e^-2u) / u^2

Processes of equal variance, spread evenly over all ln T, sum to a constant Allan variance, the floor of flicker noise:
2 ln 2 per unit of variance density. IEEE Std 952-1997 (annex C.1.4) defines the bias instability B by that floor,

    sigma^2 = (2 ln 2 / pi) B^2,        sigma = 0.664 B

Here seven processes, 0.92 decades apart, approximate it over tau = 0.01 to 1000 s. `WEIGHTS` is the minimax fit over
that span: the sum stays within 1.4 % of the floor's variance, 0.7 % of its deviation (tests/accuracy). All processes
start stationary, so a sensor starts with a bias of deviation sqrt(sum of weights) B = 2.2 B besides its turn-on bias.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from signals._kernel import det_exp

# 10^(-2.4 + 5.5 i / 6) s
TIME_CONSTANTS_S = (0.003981071706, 0.03286061487, 0.2712396143, 2.238872139, 18.47995811, 152.5382069, 1258.925412)
WEIGHTS = (0.8524, 0.6478, 0.6802, 0.6630, 0.6800, 0.6513, 0.8354)  # variance of each, in units of B^2


class FlickerProcess(NamedTuple):
    """Process x_0 = start n_0,  x_{k+1} = phi x_k + step n_{k+1}, for a bias instability of 1."""

    phi: float
    start: float
    step: float


def flicker_processes(period_s: float) -> tuple[FlickerProcess, ...]:
    """Return the processes, sampled every `period_s`.

    Processes with a time constant below the period are left out: their samples would be white noise of full variance,
    but in the sensor's mean over a period this noise almost vanishes.
    """
    processes = []
    for time_constant_s, weight in zip(TIME_CONSTANTS_S, WEIGHTS, strict=True):
        if time_constant_s >= period_s:
            phi = det_exp(-period_s / time_constant_s)
            processes.append(FlickerProcess(phi, math.sqrt(weight), math.sqrt(weight * (1.0 - phi * phi))))
    return tuple(processes)
