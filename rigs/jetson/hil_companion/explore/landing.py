"""After an outcome other than the goal: when the bench may land the vehicle, and where it had better hover until then.

Over bare ground it hovers `hover_s`. Over a roof, a car, people or what nobody has seen it goes to the nearest bare
ground that it can get to, as long as it sees its way; where there is none it hovers `unsafe_hover_s` and says what is
below.
"""

from __future__ import annotations

import cv2
import numpy as np

from hil_companion.explore.ground import GROUND, Ground
from hil_companion.explore.inflation import Berth
from hil_companion.explore.outcome import GOAL
from hil_companion.explore.plan_map import PlanMap
from hil_companion.explore.settings import FlightSettings

_WITHIN_M = 30.0


class Landing:
    """Of one flight."""

    def __init__(self, settings: FlightSettings, ground: Ground) -> None:
        self._settings, self._ground = settings, ground
        self._spot: tuple[float, float] | None = None

    def due(self, outcome: str, below: str, since_s: float) -> bool:
        """Whether it may be landed, so long after the outcome."""
        if outcome == GOAL:
            return True  # whoever set the goal chose what lies below
        return since_s >= (self._settings.hover_s if below == GROUND else self._settings.unsafe_hover_s)

    def spot(self, p_W: np.ndarray, around: PlanMap, berth: Berth) -> tuple[float, float] | None:
        """Where to go; the same again while it is good."""
        places = self._ground.places(float(p_W[0]), float(p_W[1]), _WITHIN_M)
        if self._spot is not None and self._ground.below(*self._spot) == GROUND:
            places = np.vstack([self._spot, places])
        places = places[around.holds(places)]
        rows, columns = around.fine(places)
        reachable = _reachable(around, p_W)[rows // around.blocks, columns // around.blocks]
        good = np.flatnonzero(reachable & (around.distance_m[rows, columns] >= berth.hard_m))
        self._spot = (float(places[good[0], 0]), float(places[good[0], 1])) if len(good) else None
        return self._spot


def _reachable(around: PlanMap, p_W: np.ndarray) -> np.ndarray:
    """Cells of the plan's grid that there is a way to."""
    here = around.plan_cell(float(p_W[0]), float(p_W[1]))
    passable = np.isfinite(around.price).astype(np.uint8)
    passable[here] = 1
    _, label = cv2.connectedComponents(passable, connectivity=4)
    return np.asarray(label == label[here])
