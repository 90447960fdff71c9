"""Coefficients over the angle of attack, of several sources."""

from __future__ import annotations

from dataclasses import dataclass

from hil.apps.vehicle.coefficients import Coefficients


@dataclass(frozen=True)
class Polars:
    """Coefficients over alpha in degrees, of each source that has them."""

    own: dict[float, Coefficients]
    lattice: dict[float, Coefficients]
    points: dict[float, Coefficients]
