"""Echoes of one radar frame as arrays, made from pictures and used by the synthesis.

An echo has range R and radial speed v (+ receding) at the middle of the frame, and the unit direction d_R from the
radar (frame R: x forward, y left, z up). Its amplitude A is the peak of its beat signal in ADC counts, before the
filters of the receiver. An echo by a mirror can leave in another direction than it comes back from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Echoes:
    """Arrays of n echoes, C-contiguous float64."""

    range_m: Float64  # (n,)
    speed_mps: Float64  # (n,), + receding
    direction_R: Float64  # (n, 3), unit
    amplitude: Float64  # (n,), counts, >= 0
    out_direction_R: Float64 | None = None  # (n, 3), in which echoes leave; None: as they come back
