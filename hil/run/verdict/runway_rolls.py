"""Rolls of a plane on the runway of its scene: take-off and landing, from ground truth.

takeoff_roll_m  Distance from the start to the last contact with the ground before the first flight
landing_roll_m  Distance from the first contact of the last landing to the last place in contact
centre_line_m   Greatest distance from the centre line while it rolls faster than 1 m/s
off_runway_m    Greatest distance outside the runway's rectangle while it touches the ground

Landings count where the plan lands on the runway. A hop lower than 0.3 m is part of a roll.
"""

from __future__ import annotations

import math

from hil.run.verdict.verdict import AIRBORNE_M
from signals.samples import TruthState, Vec3
from sim.scene.runway import Runway

_ROLLS_MPS = 1.0


class RunwayRolls:
    """Measures the rolls of one flight tick by tick. A plane that does not start on the runway has none to take off."""

    def __init__(self, runway: Runway, *, start_W: Vec3, lands: bool) -> None:
        """`lands`: the plan lands on the runway."""
        self._runway, self._start, self._lands = runway, start_W, lands
        self._starts = runway.contains(start_W)
        self._start_up = start_W[2]
        self._airborne = self._flown = False
        self._left = self._touched = self._last = start_W
        self._centre = self._off = 0.0

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        place = truth.p_WB
        if not truth.in_contact:
            if place[2] - self._start_up > AIRBORNE_M:
                self._airborne = self._flown = True
            return
        if self._airborne:
            self._airborne, self._touched = False, place
        self._last = place
        if not self._flown:
            self._left = place
        if not (self._lands if self._flown else self._starts):
            return
        along, right, _ = self._runway.place_of(place)
        beyond = max(-along, along - self._runway.length_m, 0.0)
        beside = max(abs(right) - 0.5 * self._runway.width_m, 0.0)
        self._off = _greater(self._off, math.hypot(beyond, beside))
        if not math.hypot(*truth.v_WB_W) <= _ROLLS_MPS:
            self._centre = _greater(self._centre, abs(right))

    def values(self) -> dict[str, float]:
        """Return what the flight has yielded so far."""
        found: dict[str, float] = {}
        if self._starts and self._flown:
            found["takeoff_roll_m"] = math.dist(self._left[:2], self._start[:2])
        if self._lands and self._flown and not self._airborne:
            found["landing_roll_m"] = math.dist(self._last[:2], self._touched[:2])
        if self._starts or self._lands:
            found |= {"centre_line_m": self._centre, "off_runway_m": self._off}
        return found

    def called_for(self) -> frozenset[str]:
        """Return the names of the measurements that the plan must yield."""
        names = {"centre_line_m", "off_runway_m"} if self._starts or self._lands else set()
        names |= {"takeoff_roll_m"} if self._starts else set()
        return frozenset(names | ({"landing_roll_m"} if self._lands else set()))


def _greater(so_far: float, value: float) -> float:
    """Return the greater value; NaN stays."""
    return so_far if value <= so_far or so_far != so_far else value
