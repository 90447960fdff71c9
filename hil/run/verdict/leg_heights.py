"""The heights that the legs between the waypoints of a plan ask for.

A leg is judged if it is level or slopes by less than `SLOPE`: autopilots change the height along a steeper one in their
own ways. Its heights are those between its ends. They count once the vehicle has flown `SETTLE_M` since the plan last
changed the height: with a take-off, a landing in its middle, or a leg that is not level. Of a steeper leg that does not
begin with a landing, gross errors count (`flight.py`). (`plane_flight.py` has other numbers, and no such distance: the
legs of planes are long and their limits wide.)
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from hil.config.missions.path import Leg
from signals.samples import Vec3

SETTLE_M = 5.0
LEVEL_M = 0.05  # a leg is level if the heights of its ends differ by less
SLOPE = 0.1  # and judged if by less than this share of its length: terrain-following surveys have hardly a level leg


class LegHeights:
    """Heights of the legs in the order of the plan."""

    def __init__(self, fly: Sequence[Leg], reaches_m: Sequence[float], landings: Collection[int]) -> None:
        """`reaches_m`: distance from each leg's end [m] at which it counts as reached.

        `landings`: indices of the legs that begin with a landing.
        """
        self._fly, self._landings = fly, frozenset(landings)
        self.settle_m = _settle_distances_m(fly, reaches_m, landings)
        self._bands_m = [(min(leg.start_W[2], leg.end_W[2]), max(leg.start_W[2], leg.end_W[2])) for leg in fly]
        self._directions = [_direction(leg) for leg in fly]

    def off_m(self, target: int, p_WB: Vec3) -> float | None:
        """Return how far the vehicle is above or below a leg's heights [m]; None where it is not judged."""
        (low, high), up = self._bands_m[target], p_WB[2]
        off_m = low - up if up < low else 0.0 if up <= high else up - high  # NaN for NaN
        settle_m = self.settle_m[target]
        if settle_m == math.inf:
            return None if target in self._landings else off_m
        if settle_m > -math.inf:
            start, (along_x, along_y) = self._fly[target].start_W, self._directions[target]
            dx, dy = p_WB[0] - start[0], p_WB[1] - start[1]
            along_m, from_start_m = dx * along_x + dy * along_y, math.sqrt(dx * dx + dy * dy)
            # The count is ahead of the vehicle: it may still be on the leg before, in another direction.
            if (along_m if 2.0 * along_m > from_start_m else -from_start_m) < settle_m:
                return None
        return off_m


def leg_length_m(leg: Leg) -> float:
    """Return the horizontal length of a leg [m]."""
    return math.hypot(leg.end_W[0] - leg.start_W[0], leg.end_W[1] - leg.start_W[1])


def bands_m(fly: Sequence[Leg], reaches_m: Sequence[float], judged: Sequence[bool]) -> list[tuple[float, float]]:
    """Return for every leg the least and the greatest height [m] at which it may be flown.

    They are those of the leg, and of the judged legs before it within `reaches_m` of its start: the count is ahead of
    the vehicle by so much.
    """
    bands: list[tuple[float, float]] = []
    for i, leg in enumerate(fly):
        heights_m = [leg.start_W[2], leg.end_W[2]]
        k, left_m = i - 1, reaches_m[i - 1] if i else 0.0
        while k >= 0 and left_m > 0.0 and judged[k] and fly[k].end_W == fly[k + 1].start_W:
            (*_, start_m), (*_, end_m), length_m = fly[k].start_W, fly[k].end_W, leg_length_m(fly[k])
            heights_m.append(end_m + min(left_m / max(length_m, LEVEL_M), 1.0) * (start_m - end_m))
            k, left_m = k - 1, left_m - length_m
        bands.append((min(heights_m), max(heights_m)))
    return bands


def _settle_distances_m(fly: Sequence[Leg], reaches_m: Sequence[float], landings: Collection[int]) -> list[float]:
    """Return for every leg the distance along it from its start [m] at which the altitude begins to count.

    Negative: before its start, while an earlier level leg is flown; minus infinity: always; infinity: never.
    """
    distances_m: list[float] = []
    level_m = 0.0  # flown level before this leg
    for i, leg in enumerate(fly):
        change_m, length_m = abs(leg.end_W[2] - leg.start_W[2]), leg_length_m(leg)
        level_m = 0.0 if i in landings else level_m
        if not change_m < max(LEVEL_M, SLOPE * length_m):
            distances_m.append(math.inf)
        else:
            always = i > 0 and level_m - SETTLE_M >= reaches_m[i - 1]
            distances_m.append(-math.inf if always else SETTLE_M - level_m)
        level_m = level_m + length_m if change_m < LEVEL_M else 0.0
    return distances_m


def _direction(leg: Leg) -> tuple[float, float]:
    """Return the horizontal direction of a leg; zeros for one without length."""
    length_m = leg_length_m(leg)
    if length_m == 0.0:
        return 0.0, 0.0
    return (leg.end_W[0] - leg.start_W[0]) / length_m, (leg.end_W[1] - leg.start_W[1]) / length_m
