"""Disturbances of a flight: wind, and faults of rotors and control surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim.physics.surface_faults import VehicleFault
from sim.scene.wind import Wind


@dataclass(frozen=True)
class Disturbances:
    """Wind and faults of rotors and surfaces that one vehicle meets."""

    wind: Wind | None = None  # None: the scene's steady wind
    seed: int = 1  # of the turbulence
    faults: Sequence[VehicleFault] = ()
