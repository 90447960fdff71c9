"""Coefficients and derivatives of a vehicle's panels, in the axes and units of flight mechanics.

C_L, C_D in the axes of the flow, C_Y, C_l, C_m, C_n about the centre of mass in x ahead, y right, z down, over q S (and
span or mean chord of the first wing). Derivatives per rad, of rates over 2 V / span, for pitch over 2 V / mean chord;
those of a surface per rad of its deflection.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim import _kernels
from sim.physics.forces.force import Effects
from sim.physics.forces.panels import Panels
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

QUANTITIES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
_STEP_RAD = 0.01
Coefficients = dict[str, float]


@dataclass(frozen=True)
class FlightPoint:
    """Flow at a vehicle: angles and rates [rad, rad/s] of x ahead, y right, z down; deflections [rad]."""

    airspeed_mps: float
    alpha_rad: float = 0.0
    beta_rad: float = 0.0
    rates_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deflections_rad: tuple[float, ...] = ()


class PanelAircraft:
    """The panels of a vehicle, away from the ground and without slipstreams."""

    def __init__(self, panels: Panels) -> None:
        self.panels = panels
        force = panels.make(Effects(ground_effect=False))
        assert isinstance(force, _kernels.Panels)
        self._force = force
        wing = panels.wings[0]
        self.area_m2, self.span_m = wing.area_m2, wing.span_m
        self.chord_m = wing.area_m2 / wing.span_m

    def coefficients(self, at: FlightPoint) -> Coefficients:
        """Return all coefficients at a point."""
        V, a, b = at.airspeed_mps, at.alpha_rad, at.beta_rad
        air = (V * math.cos(a) * math.cos(b), -V * math.sin(b), -V * math.sin(a) * math.cos(b))
        p, q, r = at.rates_radps
        deflections = list(at.deflections_rad) or [0.0] * len(self.panels.surfaces)
        (fx, fy, fz), (mx, my, mz) = self._force.wrench(air, (p, -q, -r), deflections)
        pressure = 0.5 * SEA_LEVEL_KGPM3 * V * V * self.area_m2
        forward = fx * math.cos(a) - fz * math.sin(a)
        return {
            "CL": (fz * math.cos(a) + fx * math.sin(a)) / pressure,
            "CD": -(forward * math.cos(b) - fy * math.sin(b)) / pressure,
            "CY": -fy / pressure,
            "Cl": mx / (pressure * self.span_m),
            "Cm": -my / (pressure * self.chord_m),
            "Cn": -mz / (pressure * self.span_m),
        }

    def derivatives(self, at: FlightPoint) -> dict[str, Coefficients]:
        """Return derivatives by alpha, beta, p, q, r and each surface, by central differences."""
        V = at.airspeed_mps
        found = {}
        for name, key in (("alpha", "alpha_rad"), ("beta", "beta_rad")):
            angle = getattr(at, key)
            found[name] = self._slope(replace(at, **{key: angle + _STEP_RAD}), replace(at, **{key: angle - _STEP_RAD}))
        for i, (name, length) in enumerate((("p", self.span_m), ("q", self.chord_m), ("r", self.span_m))):
            step = _STEP_RAD * 2.0 * V / length
            found[name] = self._slope(
                replace(at, rates_radps=_rates(at, i, step)),
                replace(at, rates_radps=_rates(at, i, -step)),
            )
        neutral = at.deflections_rad or (0.0,) * len(self.panels.surfaces)
        for i, surface in enumerate(self.panels.surfaces):
            found[surface.name] = self._slope(
                replace(at, deflections_rad=_moved(neutral, i, _STEP_RAD)),
                replace(at, deflections_rad=_moved(neutral, i, -_STEP_RAD)),
            )
        return found

    def _slope(self, above: FlightPoint, below: FlightPoint) -> Coefficients:
        high, low = self.coefficients(above), self.coefficients(below)
        return {name: (high[name] - low[name]) / (2.0 * _STEP_RAD) for name in QUANTITIES}


def _moved(values: Sequence[float], index: int, step: float) -> tuple[float, ...]:
    return tuple(value + step if i == index else value for i, value in enumerate(values))


def _rates(at: FlightPoint, index: int, step: float) -> tuple[float, float, float]:
    p, q, r = _moved(at.rates_radps, index, step)
    return p, q, r
