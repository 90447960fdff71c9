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
        self._spot: np.ndarray | None = None

    def due(self, outcome: str, below: str, since_s: float) -> bool:
        """Whether it may be landed, so long after the outcome."""
        if outcome == GOAL:
            return True  # whoever set the goal chose what lies below
        return since_s >= (self._settings.hover_s if below == GROUND else self._settings.unsafe_hover_s)

    def spot(self, p_W: np.ndarray, around: PlanMap, berth: Berth) -> tuple[float, float] | None:
        """Where to go; the same again while it is good."""
        reachable = _reachable(around, p_W)
        places = self._ground.places(float(p_W[0]), float(p_W[1]), _WITHIN_M)
        if self._spot is not None:
            places = np.vstack([self._spot, places])
        for place in places:
            x, y = float(place[0]), float(place[1])
            good = around.holds(place[None]) and reachable[around.plan_cell(x, y)]
            if good and around.distance_at(x, y) >= berth.hard_m and self._ground.below(x, y) == GROUND:
                self._spot = place
                return x, y
        self._spot = None
        return None


def _reachable(around: PlanMap, p_W: np.ndarray) -> np.ndarray:
    """Cells of the plan's grid that there is a way to."""
    here = around.plan_cell(float(p_W[0]), float(p_W[1]))
    passable = np.isfinite(around.price).astype(np.uint8)
    passable[here] = 1
    _, label = cv2.connectedComponents(passable, connectivity=4)
    return np.asarray(label == label[here])
