"""Differences between the elements of an array: gain and phase of single transmitters and receivers over the angle.

An element's cuts are relative to the pattern that all transmitters or receivers have in common (antenna.py): rows of
degrees, dB and degrees of phase, over azimuth and over elevation, each 0 where it is left out. Between the rows both
are straight lines, beyond them constant; azimuth and elevation are those of antenna_cut.py. Gains and phases of both
planes, and of transmitter and receiver, add up. So the channel of transmitter p and receiver k has the echo

    A 10^((g_p(d_out) + g_k(d)) / 20),   phase + psi_p(d_out) + psi_k(d)

Phases are those at the centre frequency f_c, of a delay, as a longer feed has it: psi f / f_c at the frequency f of the
sweep. How they are summed is in element_synthesis.py.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from signals._kernel import det_pow
from signals.documents.validate import StrictModel
from signals.units import RAD_PER_DEG
from sim._kernels import azimuth_elevation

Float64 = NDArray[np.float64]

_Angle = Annotated[float, Field(ge=-180.0, le=180.0)]
_Difference = Annotated[float, Field(ge=-60.0, le=20.0)]  # dB
_Phase = Annotated[float, Field(ge=-3600.0, le=3600.0)]  # degrees, unwrapped
_Rows = Annotated[tuple[tuple[_Angle, _Difference, _Phase], ...], Field(min_length=1, max_length=2000)]
Rows = tuple[tuple[float, float, float], ...]
_STEPS_PER_DEG = 20


class ElementCuts(StrictModel):
    """One transmitter or receiver: rows of degrees, dB and degrees of phase to the common pattern."""

    azimuth: _Rows | None = None
    elevation: _Rows | None = None

    @field_validator("azimuth", "elevation")
    @classmethod
    def _rising(cls, rows: Rows | None) -> Rows | None:
        if rows is not None and not all(a[0] < b[0] for a, b in pairwise(rows)):
            raise ValueError("must have rising angles")
        return rows

    def difference(self, direction_R: Float64) -> tuple[Float64, Float64]:
        """Return the factor of the amplitude and the phase [rad] in unit directions (n, 3)."""
        d = np.ascontiguousarray(direction_R, np.float64)
        azimuth, elevation = np.empty(len(d)), np.empty(len(d))
        azimuth_elevation(d, azimuth, elevation)
        factor, phase_rad = np.ones(len(d)), np.zeros(len(d))
        for rows, angle_rad in ((self.azimuth, azimuth), (self.elevation, elevation)):
            if rows is not None:
                factors, phases = _tables(rows)
                place = (angle_rad / RAD_PER_DEG + 180.0) * _STEPS_PER_DEG
                place = np.clip(place, 0.0, float(len(factors) - 2))
                node = place.astype(np.int64)
                share = place - node
                factor = factor * (factors[node] + share * (factors[node + 1] - factors[node]))
                phase_rad = phase_rad + (phases[node] + share * (phases[node + 1] - phases[node]))
        return factor, phase_rad


@lru_cache(maxsize=64)
def _tables(rows: Rows) -> tuple[Float64, Float64]:
    angles = np.arange(360 * _STEPS_PER_DEG + 2) / _STEPS_PER_DEG - 180.0
    at = [row[0] for row in rows]
    gain_db, phase_deg = (np.interp(angles, at, [row[i] for row in rows]) for i in (1, 2))
    return np.array([det_pow(10.0, 0.05 * g) for g in gain_db.tolist()]), phase_deg * RAD_PER_DEG
