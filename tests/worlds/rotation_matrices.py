"""Rotation matrices for tests, by SciPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # loads its packages when they are first used
from numpy.typing import NDArray


def rotation(q: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R of a unit quaternion w-x-y-z."""
    matrix: NDArray[np.float64] = scipy.spatial.transform.Rotation.from_quat(q, scalar_first=True).as_matrix()
    return matrix
