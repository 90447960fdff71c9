"""What somebody looks like from afar: the colours of the upper and the lower half of a box's middle.

Six numbers in CIE L*a*b*, medians, so that what is behind counts little. Lightness changes with shade and sun, and so
counts a third in `difference`.
"""

from __future__ import annotations

from typing import Sequence

import cv2
import numpy as np

_LEAST_HEIGHT_PX = 14.0
_ACROSS = (0.36, 0.64)  # of the box
_UPPER, _LOWER = (0.2, 0.42), (0.55, 0.82)
_WEIGHTS = np.array([0.33, 1.0, 1.0] * 2)


def look_of(rgb: np.ndarray, box_px: Sequence[float]) -> np.ndarray | None:
    """None where the box is too small to tell."""
    x0, y0, x1, y1 = box_px
    if y1 - y0 < _LEAST_HEIGHT_PX:
        return None
    parts = []
    for top, bottom in (_UPPER, _LOWER):
        columns = slice(max(0, int(x0 + _ACROSS[0] * (x1 - x0))), int(np.ceil(x0 + _ACROSS[1] * (x1 - x0))))
        rows = slice(max(0, int(y0 + top * (y1 - y0))), int(np.ceil(y0 + bottom * (y1 - y0))))
        patch = rgb[rows, columns]
        if patch.size == 0:
            return None
        lab = cv2.cvtColor((patch[np.newaxis].reshape(1, -1, 3) / 255.0).astype(np.float32), cv2.COLOR_RGB2LAB)
        parts.append(np.median(lab[0], axis=0))
    return np.concatenate(parts).astype(float)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """0: the same colours; above about 20 other clothes."""
    return float(np.sqrt(np.mean((_WEIGHTS * (a - b)) ** 2)))
