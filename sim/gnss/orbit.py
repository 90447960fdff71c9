"""Orbit of a navigation satellite: the elements of an almanac. Equations: sim/native/satellite_orbit.hpp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel
from sim.gnss.gps_time import WEEK_S, full_week
from sim.gnss.systems import SYSTEMS, SystemName

Radians = Annotated[float, Field(ge=-7.0, le=7.0)]


class Orbit(StrictModel):
    """Elements at the reference time `toa_s` of the GPS week `week`; the node is that at the week's start."""

    system: SystemName
    number: Annotated[int, Field(ge=1, le=63)]  # within its system
    week: Annotated[int, Field(ge=0, le=8191)]  # below 1024: ten bits, the one nearest to the run
    toa_s: Annotated[float, Field(ge=0.0, le=WEEK_S)]
    sqrt_semi_major_rtm: Annotated[float, Field(ge=4000.0, le=7000.0)]  # sqrt(m)
    eccentricity: Annotated[float, Field(ge=0.0, le=0.1)]
    inclination_rad: Annotated[float, Field(ge=0.0, le=3.1416)]
    node_rad: Radians  # longitude of the ascending node at the week's start
    node_rate_radps: Annotated[float, Field(ge=-1e-6, le=1e-6)]
    perigee_rad: Radians
    anomaly_rad: Radians  # mean anomaly at toa_s

    @property
    def name(self) -> str:
        """Name as in RINEX: a letter and two digits."""
        return f"{SYSTEMS[self.system].letter}{self.number:02d}"

    def epoch_s(self, t_s: float) -> float:
        """Return the GPS time [s] of the elements, for a run that begins at GPS time `t_s`."""
        return full_week(self.week, t_s) * float(WEEK_S) + self.toa_s


def orbit_table(orbits: Sequence[Orbit], t_s: float) -> NDArray[np.float64]:
    """Return the rows of `satellite_positions` for a run that begins at GPS time `t_s`."""
    rows = np.empty((len(orbits), 10))
    for row, o in zip(rows, orbits, strict=True):
        row[:] = (
            o.epoch_s(t_s),
            o.toa_s,
            SYSTEMS[o.system].mu_m3ps2,
            o.sqrt_semi_major_rtm * o.sqrt_semi_major_rtm,
            o.eccentricity,
            o.inclination_rad,
            o.node_rad,
            o.node_rate_radps,
            o.perigee_rad,
            o.anomaly_rad,
        )
    return rows
