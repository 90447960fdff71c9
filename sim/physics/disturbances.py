"""Disturbances of a flight: wind and faults of rotors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim.physics.faults import RotorFault
from sim.scene.wind import Wind


@dataclass(frozen=True)
class Disturbances:
    """Wind and rotor faults that one vehicle meets."""

    wind: Wind | None = None  # None: the scene's steady wind
    seed: int = 1  # of the turbulence
    faults: Sequence[RotorFault] = ()
