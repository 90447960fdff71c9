"""Legs that are too short for the turns of a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from hil.config.missions.path import Leg, LegKind


def short_legs(legs: Sequence[Leg], radius: float) -> list[tuple[str, int]]:
    """Return what is wrong with waypoints that a plane cannot tell apart, and their items."""
    found = []
    for before, leg in pairwise(legs):
        length = math.dist(leg.start_W[:2], leg.end_W[:2])
        flown = leg.kind is LegKind.FLY and before.kind is LegKind.FLY
        if flown and 1.0 < length < radius:
            found.append(
                (f"lies {length:.0f} m from the one before, within one turn of {radius:.0f} m radius", leg.seq)
            )
    return found
