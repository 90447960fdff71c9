"""What a flight to a goal was worth, measured from ground truth (the section `goal` of a bench).

It is over when the client in control says how it ended (its report has an `outcome` other than `flying`), says that it
is finished, or wants to land; else with the run.

outcome          what the client said, and what the bench wants to hear: a goal in a building is to be called that
goal_error_m     horizontal distance from the goal when it was over
clearance_m      least distance from the sphere that holds the vehicle to anything, people included, ten times a second,
                 from half the height of the flight on
contacts         ticks with contact, from the first 0.3 m above the ground until it was over
path_ratio       horizontal length of the way flown, over that of the shortest way from start to goal that keeps
                 `min_clearance_m` on the full map (`hil.goal.judgement`)

Where another outcome than `goal` is wanted, error and ratio are not judged, nor the clearance of a flight that never
got half as high.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.companion.started import use_client
from hil.config.schema import Goal
from hil.goal.true_slice import TrueSlice, true_slice
from hil.signals.samples import TruthState, Vec3
from hil.signals.time import NS_PER_S
from hil.verdict import AIRBORNE_M, Row, rows_within
from sim._kernels import RayCaster, Vicinity
from sim.frame.geometry import FrameGeometry
from sim.physics.vehicle import Vehicle

FLYING, AT_GOAL = "flying", "goal"
_EVERY_NS = NS_PER_S // 10
_ROUND_M = 45.0  # the full map reaches so far beyond start and goal
_DEFAULT_CLEARANCE_M = 0.5


@dataclass(frozen=True)
class GoalResult:
    """None: not measured."""

    outcome: str = ""
    why: str = ""
    t_s: float | None = None
    goal_error_m: float | None = None
    clearance_m: float | None = None
    contacts: int = 0
    path_m: float | None = None
    shortest_m: float | None = None
    path_ratio: float | None = None
    client: Mapping[str, Any] = field(default_factory=dict)

    def as_map(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in type(self).__dataclass_fields__}


class GoalMeasurement:
    """Watches truth and the client's words while the flight goes on; `conclude` afterwards."""

    def __init__(self, goal: Goal, vehicle: Vehicle) -> None:
        self._goal, self._radius_m = goal, vehicle_radius_m(vehicle)
        self._report: Mapping[str, Any] = {}
        self._over_ns: int | None = None
        self._track: list[tuple[int, Vec3]] = []
        self._home: Vec3 | None = None
        self._airborne = False
        self._contacts = 0
        self._last: TruthState | None = None
        self.result = GoalResult()

    def add(self, truth: TruthState) -> None:
        """Every tick, in order."""
        if self._over_ns is not None and truth.t_ns > self._over_ns:
            return
        if self._home is None:
            self._home = truth.p_WB
        self._airborne = self._airborne or truth.p_WB[2] > self._home[2] + AIRBORNE_M
        self._contacts += self._airborne and truth.in_contact
        self._last = truth
        if truth.t_ns % _EVERY_NS == 0:
            self._track.append((truth.t_ns, truth.p_WB))

    def reported(self, report: Mapping[str, Any], t_ns: int) -> None:
        """What the client in control says of itself."""
        self._report = report
        if report.get("outcome", FLYING) != FLYING:
            self.over(t_ns)

    def over(self, t_ns: int) -> None:
        """The flight to the goal has ended; landing is no part of it."""
        if self._over_ns is None:
            self._over_ns = t_ns

    def judged(self) -> tuple[list[Row], list[str]]:
        """Measurements beside their limits, and why the flight fails."""
        return _judged(self.result, self._goal)

    def conclude(self, geometry: FrameGeometry) -> None:
        """Everything that takes a while, after the flight. Poses what moves at times that are over."""
        goal, last = self._goal, self._last
        if last is None or self._home is None:
            return
        (x, y, z), home = goal.p_W, self._home
        half_m = home[2] + 0.5 * (z - home[2])
        first = next((i for i, (_, p) in enumerate(self._track) if p[2] >= half_m), len(self._track))
        flown = self._track[first:]
        clearance_m = path_m = shortest_m = ratio = None
        if flown:
            meter = Clearance(geometry)
            clearance_m = min(meter.nearest_m(p, t_ns) for t_ns, p in flown) - self._radius_m
            path_m = length_m([(p[0], p[1]) for _, p in flown])
            berth_m = self._radius_m + (goal.min_clearance_m or _DEFAULT_CLEARANCE_M)
            area = tuple(f(home[i], goal.p_W[i]) + s for f, s in ((min, -_ROUND_M), (max, _ROUND_M)) for i in (0, 1))
            full = true_slice(
                geometry, low_m=z - berth_m, high_m=z + berth_m, area_W=(area[0], area[1], area[2], area[3])
            )
            best = shortest_path(full, (home[0], home[1]), (x, y), berth_m=berth_m)
            if best is not None:
                shortest_m = length_m(best)
                ratio = path_m / shortest_m if shortest_m > 0.0 else None
        outcome = str(self._report.get("outcome", ""))
        self.result = GoalResult(
            outcome,
            str(self._report.get("why", "")),
            last.t_ns / NS_PER_S,
            math.dist(last.p_WB[:2], (x, y)),
            clearance_m,
            self._contacts,
            path_m,
            shortest_m,
            ratio,
            dict(self._report),
        )


def _judged(result: GoalResult, goal: Goal) -> tuple[list[Row], list[str]]:
    reasons: list[str] = []
    if result.outcome != goal.outcome:
        said = f"ended as {result.outcome!r}" if result.outcome else "said of no outcome"
        why = f" ({result.why})" if result.why else ""
        reasons.append(f"the client {said}{why}, where {goal.outcome!r} is wanted")
    at_goal = goal.outcome == AT_GOAL
    flown = result.clearance_m is not None or at_goal  # it may have ended before it was half as high as it was to fly
    rows, failed = rows_within(
        ("goal_error_m", result.goal_error_m, goal.within_m if at_goal else None, "m", False),
        ("clearance_m", result.clearance_m, goal.min_clearance_m if flown else None, "m", True),
        ("path_ratio", result.path_ratio, goal.max_path_ratio if at_goal else None, "", False),
        ("contacts", float(result.contacts), 0.0, "", False),
    )
    return rows, [*reasons, *failed]


_REACH_M = 5.0
_RAYS, _FINE_RAYS = 4000, 150
_SPACING_RAD = math.sqrt(4.0 * math.pi / _RAYS)


def vehicle_radius_m(vehicle: Vehicle) -> float:
    """Of the sphere round the body's origin that holds the whole vehicle, propellers included."""
    blades = vehicle.rotor_constants.radius_m
    return max(vehicle.bounding_radius_m, *(math.hypot(*rotor.position_m) + blades for rotor in vehicle.rotors))


class Clearance:
    """Distances in one scene [m] from a place to the nearest surface, people included; `_REACH_M` where none is nearer.

    Rays in all directions, then a finer bundle round the shortest: at `_REACH_M` neighbouring rays lie 0.3 m apart, at
    1 m 6 cm, the finer ones a tenth of that. A surface is nearest where it is met at a right angle, so that the
    distance found is too long by no more than 2 mm at 1 m; a wire thinner than the rays' distance may be missed.
    """

    def __init__(self, geometry: FrameGeometry) -> None:
        self._geometry = geometry
        self._caster = RayCaster(geometry.native)
        n = _RAYS
        up = 1.0 - (2.0 * np.arange(n) + 1.0) / n
        turn = np.arange(n) * (math.pi * (3.0 - math.sqrt(5.0)))
        level = np.sqrt(1.0 - up * up)
        self._sphere = np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=1)
        m = _FINE_RAYS
        away = _SPACING_RAD * np.sqrt((np.arange(m) + 0.5) / m)
        turn = np.arange(m) * (math.pi * (3.0 - math.sqrt(5.0)))
        self._bundle = np.stack([away * np.cos(turn), away * np.sin(turn)], axis=1)

    def nearest_m(self, p_W: tuple[float, float, float], t_ns: int) -> float:
        """From this place to the nearest surface, as everything stands at `t_ns`."""
        self._geometry.expect(t_ns)
        self._geometry.bring(Vicinity(p_W, p_W, _REACH_M))
        range_m = self._cast(p_W, self._sphere)
        best = int(np.argmin(range_m))
        if not math.isfinite(range_m[best]):
            return _REACH_M
        d = self._sphere[best]
        a = np.cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.9 else (0.0, 1.0, 0.0))
        a /= np.linalg.norm(a)
        finer = d + self._bundle[:, :1] * a + self._bundle[:, 1:] * np.cross(d, a)
        finer /= np.linalg.norm(finer, axis=1, keepdims=True)
        return min(float(range_m[best]), float(self._cast(p_W, finer).min()), _REACH_M)

    def _cast(self, p_W: tuple[float, float, float], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        n = len(directions)
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        origins = np.ascontiguousarray(np.broadcast_to(np.asarray(p_W), (n, 3)))
        self._caster.cast(origins, np.ascontiguousarray(directions), 0.0, _REACH_M, range_m, geom)
        return np.where(geom >= 0, range_m, math.inf)


Point = tuple[float, float]


def shortest_path(place: TrueSlice, start_W: Point, goal_W: Point, *, berth_m: float) -> list[Point] | None:
    """Points from start to goal; None where there is no way. Both ends count as free where they are.

    The explorer's own A* over cells that are at least `berth_m` from anything, all at one price, and its straightening:
    no shorter than the shortest way, and seldom more than a per cent longer.
    """
    use_client()
    from hil_companion.explore.astar import connected, search
    from hil_companion.explore.plan_map import PlanMap
    from hil_companion.explore.route import straightened

    distance_m = _distance_m(place)
    free = distance_m >= berth_m
    start, goal = place.cell_of(*start_W), place.cell_of(*goal_W)
    if not (place.inside(*start) and place.inside(*goal)):
        return None
    free[start] = free[goal] = True
    price = np.where(free, 1.0, np.inf)
    found = search(price, start, goal) if connected(price, start, goal) else None
    if found is None:
        return None
    points = np.array([start_W, *(place.centre_of(*cell) for cell in found[0][1:-1]), goal_W])
    full = PlanMap(distance_m, ~free, price, place.origin_W, place.cell_m, 1, np.zeros((0, 4)))
    ways = (straightened(full, points), straightened(full, points[::-1])[::-1])
    return min(([(float(x), float(y)) for x, y in way] for way in ways), key=length_m)


def length_m(points: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _distance_m(place: TrueSlice) -> NDArray[np.float32]:
    """Of every cell's middle from the nearest occupied cell's."""
    if not place.occupied.any():
        return np.full(place.occupied.shape, 1e3, np.float32)
    clear = np.where(place.occupied, 0, 1).astype(np.uint8)
    # Surfaces lie anywhere in their cells: on the average half a cell nearer than the cell's middle tells.
    return np.asarray(cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * place.cell_m, np.float32)
