"""Series that a plane's report shows beside the flown path: airspeed, angle of attack, sideslip, energy, surfaces."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.rotation import matrix_of
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from signals.units import DEG_PER_RAD, STANDARD_GRAVITY_MPS2

_RATE_HZ = 10
_LEAST_MPS = 3.0  # airspeed below which the angles of the flow mean nothing
_MAX_ROWS = 36_000  # an hour


class PlaneTrackArrays(NamedTuple):
    """One row per kept tick."""

    t_s: NDArray[np.float64]
    airspeed_mps: NDArray[np.float64]
    stall_mps: float
    attack_deg: NDArray[np.float64]  # NaN while slow
    sideslip_deg: NDArray[np.float64]
    bank_deg: NDArray[np.float64]
    height_m: NDArray[np.float64]  # over the start
    energy_m: NDArray[np.float64]  # height and speed together: h + V^2 / 2g
    surface_deg: NDArray[np.float64]  # (n, surfaces)


class PlaneTrack:
    """Keeps ten rows a second, at most an hour."""

    def __init__(self, stall_mps: float, tick_ns: int, wind_at: Callable[[], Vec3]) -> None:
        self._stall_mps, self._wind_at = stall_mps, wind_at
        self._stride = max(1, NS_PER_S // _RATE_HZ // tick_ns)
        self._rows = array("d")
        self._columns = 7
        self._home_up: float | None = None

    def add(self, truth: TruthState) -> None:
        """Keep this tick if it is due."""
        if truth.tick % self._stride or len(self._rows) >= _MAX_ROWS * self._columns:
            return
        if self._home_up is None:
            self._home_up = truth.p_WB[2]
            self._columns = 7 + len(truth.surface_rad)
        R = matrix_of(truth.q_WB)
        wind = self._wind_at()
        v = [a - b for a, b in zip(truth.v_WB_W, wind, strict=True)]
        x, y, z = (R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2] for i in range(3))
        airspeed = math.sqrt(x * x + y * y + z * z)
        fast = airspeed >= _LEAST_MPS
        height = truth.p_WB[2] - self._home_up
        self._rows.extend(
            (
                truth.t_ns / NS_PER_S,
                airspeed,
                math.atan2(-z, x) * DEG_PER_RAD if fast else math.nan,
                math.asin(max(-1.0, min(1.0, -y / airspeed))) * DEG_PER_RAD if fast else math.nan,
                math.atan2(R[7], R[8]) * DEG_PER_RAD,
                height,
                height + airspeed * airspeed / (2.0 * STANDARD_GRAVITY_MPS2),
                *(angle * DEG_PER_RAD for angle in truth.surface_rad),
            )
        )

    def arrays(self) -> PlaneTrackArrays:
        """Return copies of the kept ticks."""
        rows = np.array(self._rows, np.float64).reshape(-1, self._columns)
        t, airspeed, attack, slip, bank, height, energy = rows[:, :7].T
        return PlaneTrackArrays(t, airspeed, self._stall_mps, attack, slip, bank, height, energy, rows[:, 7:])
