"""Counts of a radiometric thermal camera: the apparent temperature in steps of 0.01 K, from 0 to 655.35 K.

This is the output of FLIR's Lepton and Boson in their linear mode ("TLinear", resolution 0.01). Noise and other steps
belong to the camera's key `infrared` (sim/frame/thermal_device.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.classes import Classes

COUNTS_PER_K = 100.0
MOST_COUNTS = 65535.0


def fill(pictures: Mapping[str, NDArray[Any]], _classes: Classes, out: NDArray[np.uint16]) -> None:
    """Write the counts of each pixel."""
    counts = np.floor(pictures["temperature"].astype(np.float64) * COUNTS_PER_K + 0.5)
    out[:] = np.minimum(np.maximum(counts, 0.0), MOST_COUNTS).astype(np.uint16)
