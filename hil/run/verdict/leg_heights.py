"""The heights that the legs between the waypoints of a plan ask for.

A leg is judged if it is level or slopes by less than `SLOPE`: autopilots change the height along a steeper one in their
own ways. (For planes `plane_flight.py` has other numbers.) Its heights are those between its ends, and those of a
sloping leg before it within the reach of that leg's end, because the count is ahead of the vehicle by so much.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from hil.config.missions.path import Leg
from signals.samples import Vec3

SETTLE_M = 5.0
LEVEL_M = 0.05  # a leg is level if the heights of its ends differ by less
SLOPE = 0.1  # or by less than this share of its length: terrain-following surveys have hardly a level leg


class LegHeights:
    """Heights of the legs in the order of the plan."""

    def __init__(self, fly: Sequence[Leg], reaches_m: Sequence[float], landings: Collection[int]) -> None:
        """`reaches_m`: distance from each leg's end [m] at which it counts as reached. `landings`: legs after one."""
        self._fly = fly
        self.settle_m = _settle_distances_m(fly, landings)
        self._bands_m = bands_m(fly, reaches_m, [_is_level(leg) for leg in fly])

    def off_m(self, target: int, p_WB: Vec3) -> float | None:
        """Return how far the vehicle is above or below a leg's heights [m]; None where it is not judged."""
        settle_m, start = self.settle_m[target], self._fly[target].start_W
        dx, dy = p_WB[0] - start[0], p_WB[1] - start[1]
        if dx * dx + dy * dy < settle_m * settle_m:
            return None
        (low, high), up = self._bands_m[target], p_WB[2]
        return low - up if up < low else 0.0 if up <= high else up - high  # NaN for NaN


def leg_length_m(leg: Leg) -> float:
    """Return the horizontal length of a leg [m]."""
    return math.hypot(leg.end_W[0] - leg.start_W[0], leg.end_W[1] - leg.start_W[1])


def _settle_distances_m(fly: Sequence[Leg], landings: Collection[int]) -> list[float]:
    """Return for every leg the distance from its start [m] at which the altitude begins to count.

    It is 0 once level flight has lasted `SETTLE_M`, and infinite on a slope. The first leg, and those to waypoints in
    `landings`, follow a climb.
    """
    distances: list[float] = []
    flown_level_m = 0.0
    for i, leg in enumerate(fly):
        flown_level_m = 0.0 if i in landings else flown_level_m
        if _is_level(leg):
            distances.append(max(0.0, SETTLE_M - flown_level_m))
            flown_level_m += leg_length_m(leg)
        else:
            distances.append(math.inf)
            flown_level_m = 0.0
    return distances


def bands_m(fly: Sequence[Leg], reaches_m: Sequence[float], level: Sequence[bool]) -> list[tuple[float, float]]:
    """Return for every leg the least and the greatest height [m] at which it may be flown. `level`: it is judged."""
    bands: list[tuple[float, float]] = []
    for i, leg in enumerate(fly):
        heights_m = [leg.start_W[2], leg.end_W[2]]
        before = fly[i - 1] if i else leg
        if i and before.end_W == leg.start_W and level[i - 1]:
            share = min(reaches_m[i - 1] / max(leg_length_m(before), LEVEL_M), 1.0)
            heights_m.append(before.end_W[2] + share * (before.start_W[2] - before.end_W[2]))
        bands.append((min(heights_m), max(heights_m)))
    return bands


def _is_level(leg: Leg) -> bool:
    return abs(leg.end_W[2] - leg.start_W[2]) < max(LEVEL_M, SLOPE * leg_length_m(leg))
