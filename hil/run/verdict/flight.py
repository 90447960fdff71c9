"""Judges a flight against its plan and limits, from ground truth instead of the autopilot's estimate.

Definitions. The plan's legs are straight lines in W; "horizontal" means in the x-y plane.

reached            Waypoints count in order, and a missed waypoint stops the count. A waypoint is reached when the true
                   position comes within its acceptance radius plus a margin horizontally, and within a height
                   vertically. The margin is there because the autopilot judges by its estimate. Margin and height are
                   the flight's own limits of cross-track and altitude error (`UNJUDGED_M` if a limit is null), but at
                   least `REACH_MARGIN_M` and `REACH_HEIGHT_M`: a flight that may be 3 m off its leg may be 3 m off its
                   corner. The vehicle must have flown there, though, and the middle of a square is 0.7 of a side from
                   its corners: radius and margin together reach no further than half of the longer of the legs that
                   meet at the waypoint, or, where that is more, than the radius plus the lesser of `REACH_MARGIN_M`
                   and an eighth of that leg. A margin above `UNJUDGED_M` reaches no further than half of its own leg,
                   and a height above it, or without a limit, no lower than half of the waypoint's height.
max_cross_track_m  Greatest horizontal distance, from the first waypoint reached to the last and on to within reach of a
                   landing elsewhere, between the true position and the nearest point of the leg being flown (to the
                   next waypoint not yet reached) or its neighbours. The neighbours are included because the count
                   changes legs a little before the corner: one on each side, or more past short legs and repeated
                   waypoints, at most `WINDOW_LEGS`. A mission of a single waypoint is measured on the leg that leads
                   to it, from the end of the climb. A plan that stays over one place has no leg: the distance from
                   that place counts, from the end of the climb to the descent.
altitude_error_m   Greatest distance of z from the heights of the leg being flown (`leg_heights.py`), while cross-track
                   is measured and that leg is level or slopes gently. After a climb, or a leg that is not level,
                   the first `SETTLE_M` do not count. Of steeper legs, and on the way to a landing elsewhere, errors of
                   more than twice the reach in height and 1 m count, once they were flown to their ends. Of a wait
                   that was flown, out of reach of places before at other heights: the distance from the place's
                   height, from `SETTLE_S` after the arrival until the wait may be over.
final_error_m      Horizontal distance from the last true position to the end of the plan. If the plan ends at a
                   waypoint: to the edge of its acceptance radius, where autopilots take it as reached. If the plan
                   ends on the ground: measured only if the vehicle landed.
holds              A waypoint, or a take-off, with a time to wait was flown only if the vehicle was within its reach for
                   that time, less `LESS_HOLD_S`, before it left for the next one. A moment within reach of several
                   counts for the first of them that still lacks time: waits at one place add up.
turns              A waypoint with a number of circles was flown only if the vehicle turned about it that often, less
                   `LESS_TURNS`, in their direction, before it reached the next one.
speeds             Where the plan commands a speed, the vehicle is faster at most by `MARGIN_MPS`, or by
                   `MARGIN_SHARE` of that speed (`leg_speeds.py`).
landings           What follows a landing in the middle of the plan counts once the vehicle has come to rest on the
                   ground within reach of its place; on the way there nothing is measured against the plan.
climb              A plan without waypoints is completed only if the vehicle came up to the top of its take-off, less
                   `REACH_HEIGHT_M` or half the climb, whichever is less.
landing_speed_mps  Greatest downward speed in the tick before the vehicle, having been in the air, touched the ground.
landed_tilt_deg    Greatest angle between the body's z axis (of a tailsitter x) and the vertical, from touch-down on.

A limit fails if its value is NaN, or if the plan calls for the measurement and the flight did not yield it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from hil.config.missions.path import ACCEPTANCE_RADIUS_M, Leg, LegKind, waypoint_legs
from hil.config.missions.script import Outcome
from hil.config.schema import Limits
from hil.run.verdict.hold import LESS_HOLD_S, Hold
from hil.run.verdict.landings import Landings
from hil.run.verdict.leg_heights import LEVEL_M, LegHeights, leg_length_m
from hil.run.verdict.leg_speeds import LegSpeeds
from hil.run.verdict.take_off_height import TakeOffHeight
from hil.run.verdict.verdict import AIRBORNE_M, REST_CONTACT_NS, REST_SPEED_MPS, Row, Verdict
from signals.documents.validate import unit_of
from signals.rotation import cos_tilt_of
from signals.samples import Quat, TruthState, Vec3

REACH_MARGIN_M = 1.0
REACH_HEIGHT_M = 2.0
UNJUDGED_M = 10.0
LESS_TURNS = 0.25  # of a circle: it may begin anywhere on it
STILL_M = 0.05  # a plan whose legs are all shorter stays over one place
TIPPED_DEG = 30.0
WINDOW_LEGS = 8  # most legs on each side of the one being flown to which cross-track is measured


@dataclass(frozen=True)
class Measurements:
    """Measurements of a flight; None: the flight did not yield it."""

    waypoints: int
    reached: int
    completed: bool
    landed: bool
    tipped: bool
    max_cross_track_m: float | None
    altitude_error_m: float | None
    final_error_m: float | None
    landing_speed_mps: float | None
    landed_tilt_deg: float | None
    called_for: frozenset[str]  # names of the fields above that this plan must yield
    take_off_missed: str = ""  # of a plan without waypoints: how far it stayed below its take-off, in words
    hold_missed: str = ""  # the first place at which the vehicle did not wait, or circle, in words
    speed_missed: str = ""  # the first leg that the vehicle flew faster than the plan commands, in words
    landing_missed: str = ""  # the first landing in the middle of the plan that was not flown, in words
    endless_item: int | None = None  # the jump, numbered from 0, that keeps the plan from ever ending


class FlightMeasurement:
    """Measures a flight tick by tick, in constant memory and time per tick whatever the length of the plan.

    `legs` come from `planned_path`. Touch-down is detected at every tick, everything else at every `stride`th.
    """

    def __init__(
        self,
        legs: Sequence[Leg],
        limits: Limits | None = None,
        *,
        stride: int = 10,
        cos_tilt: Callable[[Quat], float] = cos_tilt_of,
        whole: bool = False,
    ) -> None:
        """`cos_tilt` returns the cosine of the angle between what is up in the vehicle and the vertical.

        `whole`: what a plan has besides places is judged, too: times to wait, speeds, and landings in its middle.
        """
        self._cos_tilt = cos_tilt
        limits = limits or Limits()
        self._stride = stride
        height_m = max(REACH_HEIGHT_M, UNJUDGED_M if limits.altitude_error_m is None else limits.altitude_error_m)
        self._fly_legs = waypoint_legs(legs)
        climbs = [leg for leg in legs if leg.kind is LegKind.CLIMB][:1]
        self._places = [*self._fly_legs, *climbs]  # the take-off is number -1
        self._reaches_m = [*reaches_m(self._fly_legs, limits), *map(top_reach_m, climbs)]
        home_up_m = legs[0].start_W[2] if legs else 0.0
        least_m = REACH_HEIGHT_M if limits.altitude_error_m is None else UNJUDGED_M
        self._above_m = height_m
        self._below_m = [min(height_m, max(least_m, 0.5 * (leg.end_W[2] - home_up_m))) for leg in self._places]
        landings = Landings(legs, reach_m=landing_reach_m(limits))
        self._whole = whole
        self._landings = landings if whole else Landings((), reach_m=0.0)
        self._speeds = LegSpeeds(self._fly_legs, off_m=_margin_m(limits)) if whole else None
        # The count may be ahead by the reach, and on to the next places within it.
        self._gross_m = 2.0 * height_m + 1.0
        self._heights = LegHeights(self._fly_legs, self._reaches_m, landings.due)
        self._nearby_legs = [self._neighbours(target) for target in range(len(self._fly_legs))]
        self._last_leg = legs[-1] if legs else None
        approaches = [leg.kind for leg in legs[-3:]] == [LegKind.FLY, LegKind.APPROACH, LegKind.DESCENT]
        approaches = approaches and whole and not legs[-3].turns
        self._approach = legs[-2] if approaches else None  # None: there is none, or it is over
        self._landing_reach_m = landing_reach_m(limits)
        self._approach_m: float | None = None  # greatest distance from it
        self._steep_m: float | None = None  # greatest error of height of the present leg, if it is steep, or of it
        stays = all(leg_length_m(leg) <= STILL_M for leg in legs)
        self._hover_W = self._fly_legs[-1].end_W if self._fly_legs and stays else None
        endless = self._last_leg is not None and self._last_leg.kind is LegKind.ENDLESS
        self._endless_item = legs[-1].seq if endless else None
        self._take_off = TakeOffHeight(legs, reach_height_m=REACH_HEIGHT_M)
        waits_s = {i: self._places[i].wait_s for i in range(-len(climbs), len(self._fly_legs))}
        self._holds = {i: Hold(wait_s) for i, wait_s in waits_s.items() if whole and wait_s > LESS_HOLD_S}
        self._level_holds = {i for i in self._holds if not self._counts_early(i)}
        self._staying = [i for i in self._holds if i < 0]  # places reached, of which the time to wait is not over
        self._stay_ns: int | None = None  # time of the last measured tick, if it was within reach of one of them
        self._turns = {i: leg.turns for i, leg in enumerate(self._fly_legs) if whole and abs(leg.turns) > LESS_TURNS}
        self._turned: dict[int, float] = {}  # most turns flown in their direction: the way on may turn back
        self._bearing = self._turning = 0.0  # from the waypoint that is circled, and turns so far
        self._waypoint = 0  # index of the next waypoint to reach
        self._measuring = False
        self._cross_track_m: float | None = None
        self._altitude_m: float | None = None
        self._landing_speed_mps: float | None = None
        self._home_up_m: float | None = None
        self._airborne = False
        self._touched = False  # since the last take-off
        self._contact = True  # in the previous tick
        self._contact_ns = 0
        self._min_upright: float | None = None  # cosine of the greatest tilt since touch-down
        self._previous: TruthState | None = None

    @property
    def counts(self) -> tuple[int, int]:
        """Waypoints reached so far, and waypoints of the plan."""
        return self._waypoint, len(self._fly_legs)

    def _neighbours(self, target: int) -> tuple[Leg, ...]:
        """Return the legs that the vehicle may be on while leg `target` is counted as being flown.

        The count may be ahead of the vehicle by the distance at which a waypoint counts as reached, so legs shorter
        than that do not end the window. Legs without length are left out.
        """
        fly = self._fly_legs
        legs = [fly[target]]
        for step in (-1, 1):
            reach_m = self._reaches_m[target]
            i, count, length_m = target + step, 0, 0.0
            while 0 <= i < len(fly) and count < WINDOW_LEGS and (length_m < reach_m if step < 0 else not count):
                leg = fly[i]
                if leg_length_m(leg) > 0.0:
                    legs.append(leg)
                    count += 1
                    length_m += leg_length_m(leg)
                    reach_m = max(reach_m, self._reaches_m[i])
                i += step
        return tuple(legs)

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        contact = truth.in_contact
        if contact:
            self._contact_ns = truth.t_ns
            if not self._contact and self._airborne and self._previous is not None:
                # The tick that touched has already slowed the vehicle, so the speed of the tick before counts.
                self._landing_speed_mps = _greater(self._landing_speed_mps, -self._previous.v_WB_W[2])
                self._touched = True
        self._contact = contact
        self._previous = truth
        if truth.tick % self._stride == 0:
            self._measure(truth)

    def _measure(self, truth: TruthState) -> None:
        """Update everything that is measured once a stride."""
        up = truth.p_WB[2]
        self._take_off.add(up)
        if self._home_up_m is None:
            self._home_up_m = up
        if not truth.in_contact and up > self._home_up_m + AIRBORNE_M:
            self._airborne = True
            if self._touched:  # took off again, or bounced high
                self._touched = False
                self._min_upright = None
        if self._touched:
            upright = self._cos_tilt(truth.q_WB)
            if self._min_upright is None or not upright >= self._min_upright:
                self._min_upright = upright
        due = self._landings.due
        if due:
            self._landings.add(truth, self._waypoint)
        if self._airborne and self._waypoint < len(self._fly_legs) and not (due and due.get(self._waypoint)):
            self._follow(truth)
        if self._approach is not None and self._waypoint == len(self._fly_legs):
            self._follow_approach(self._approach, truth.p_WB)
        if self._waypoint - 1 in self._turns:
            self._circle(truth.p_WB)
        if self._staying and self._airborne:
            self._stay(truth.t_ns, truth.p_WB)
        if self._airborne and self._hover_W is not None and up >= self._hover_W[2] - REACH_HEIGHT_M / 2:
            drift_m = math.dist(truth.p_WB[:2], self._hover_W[:2])
            self._cross_track_m = _greater(self._cross_track_m, drift_m)

    def _follow(self, truth: TruthState) -> None:
        """Count waypoints, and measure against the leg being flown."""
        fly, target, p_WB = self._fly_legs, self._waypoint, truth.p_WB
        if target == 0 and not self._measuring and len(fly) == 1:
            self._measuring = p_WB[2] >= fly[0].start_W[2] - REACH_HEIGHT_M / 2
        if target > 0 or self._measuring:
            distance_m = min(horizontal_distance_m(p_WB, leg) for leg in self._nearby_legs[target])
            self._cross_track_m = _greater(self._cross_track_m, distance_m)
            off_m = self._heights.off_m(target, p_WB)
            if off_m is not None and self._heights.settle_m[target] == math.inf:
                if self._whole and not off_m <= self._gross_m:
                    self._steep_m = _greater(self._steep_m, off_m)
            elif off_m is not None:
                self._altitude_m = _greater(self._altitude_m, off_m)
        if self._speeds is not None:
            self._speeds.add(truth, target)
        if self._is_reached(target, p_WB):
            self._waypoint += 1
            self._take_steep()
            for i in self._staying:
                self._holds[i].onward |= not self._is_reached(i, fly[target].end_W)
            if target in self._holds:
                self._staying.append(target)

    def _follow_approach(self, leg: Leg, p_WB: Vec3) -> None:
        """Measure on the way from the last waypoint to above the landing place; it counts once the vehicle is there."""
        if math.dist(p_WB[:2], leg.end_W[:2]) <= self._landing_reach_m:
            self._approach = None
            if self._approach_m is not None:
                self._cross_track_m = _greater(self._cross_track_m, self._approach_m)
            self._take_steep()
            return
        distance_m = min(horizontal_distance_m(p_WB, near) for near in (leg, *self._nearby_legs[-1]))
        self._approach_m = _greater(self._approach_m, distance_m)
        off_m = abs(p_WB[2] - leg.end_W[2])
        if not off_m <= self._gross_m:
            self._steep_m = _greater(self._steep_m, off_m)

    def _take_steep(self) -> None:
        """Let the heights of a steep leg, or of the way to a landing elsewhere, count: it was flown to its end."""
        if self._steep_m is not None:
            self._altitude_m, self._steep_m = _greater(self._altitude_m, self._steep_m), None

    def _stay(self, t_ns: int, p_WB: Vec3) -> None:
        """Count the time at the waypoints at which the plan waits: for one at a time, that to be left first."""
        inside = {i for i in self._staying if self._is_reached(i, p_WB)}
        if inside:
            first = min(inside)
            if first in self._level_holds:
                self._holds[first].add_height(t_ns, abs(p_WB[2] - self._places[first].end_W[2]))
            if self._stay_ns is not None:
                self._holds[first].add(t_ns - self._stay_ns)
        self._staying = [
            i for i in self._staying if self._holds[i].missed and (i in inside or not self._holds[i].onward)
        ]
        self._stay_ns = t_ns if inside and self._staying else None

    def _circle(self, p_WB: Vec3) -> None:
        """Count the turns about the waypoint reached last."""
        i = self._waypoint - 1
        x, y, _ = self._fly_legs[i].end_W
        bearing = math.atan2(p_WB[1] - y, p_WB[0] - x)
        if i not in self._turned:
            self._turned[i], self._bearing, self._turning = 0.0, bearing, 0.0
        change = math.remainder(bearing - self._bearing, math.tau) / math.tau
        self._turning -= math.copysign(change, change * self._turns[i])
        self._bearing, self._turned[i] = bearing, max(self._turned[i], self._turning)

    def _missed(self) -> Iterator[str]:
        """Yield the waits and circles that were not flown, of the places reached, in words."""
        for i, hold in self._holds.items():
            if i < self._waypoint and hold.missed:
                yield hold.text(i + 1)
        for i, turns in self._turns.items():
            turned = self._turned.get(i, 0.0)
            if i < self._waypoint and turned < abs(turns) - LESS_TURNS:
                yield f"the vehicle flew {turned:.2f} turns about waypoint {i + 1}; the plan makes {abs(turns):g}"

    def _counts_early(self, target: int) -> bool:
        """Return True for a place that counts while the vehicle still is at one before, at another height."""
        x, y, z = self._places[target].end_W
        while target >= 0:
            before_W = self._places[target].start_W
            off_m, up_m = math.hypot(before_W[0] - x, before_W[1] - y), abs(before_W[2] - z)
            if off_m > 2.0 * self._reaches_m[target] or up_m > 2.0 * self._above_m:
                return False
            if up_m > LEVEL_M:
                return True
            target -= 1
        return False

    def _is_reached(self, target: int, p_WB: Vec3) -> bool:
        """Return True within reach of a waypoint, or with -1 of the take-off."""
        x, y, z = self._places[target].end_W
        dx, dy, dz = p_WB[0] - x, p_WB[1] - y, p_WB[2] - z
        radius_m = self._reaches_m[target]
        return dx * dx + dy * dy <= radius_m * radius_m and -self._below_m[target] <= dz <= self._above_m

    def result(self) -> Measurements:
        """Return the measurements so far; call it after the flight."""
        last, plan_end = self._previous, self._last_leg
        to_ground = plan_end is not None and plan_end.kind is LegKind.DESCENT
        landed = False
        final_error_m = None
        if last is not None and self._touched:
            vx, vy, vz = last.v_WB_W
            still = vx * vx + vy * vy + vz * vz <= REST_SPEED_MPS * REST_SPEED_MPS
            landed = still and last.t_ns - self._contact_ns <= REST_CONTACT_NS
        if last is not None and plan_end is not None and self._airborne and (landed or not to_ground):
            dx, dy = last.p_WB[0] - plan_end.end_W[0], last.p_WB[1] - plan_end.end_W[1]
            final_error_m = math.sqrt(dx * dx + dy * dy)
            if plan_end.kind is LegKind.FLY:  # the plan asks for no more than its acceptance radius
                final_error_m = max(0.0, final_error_m - plan_end.acceptance_radius_m)
        tilt_deg = None
        if self._min_upright is not None:
            tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, self._min_upright))))
        altitude_m = self._altitude_m
        for hold in self._holds.values():
            if hold.off_m is not None and not hold.missed:
                altitude_m = _greater(altitude_m, hold.off_m)
        all_reached = self._waypoint == len(self._fly_legs)
        hold_missed = next(self._missed(), "")
        return Measurements(
            waypoints=len(self._fly_legs),
            reached=self._waypoint,
            completed=plan_end is not None
            and self._endless_item is None
            and all_reached
            and not self._take_off.missed
            and not hold_missed
            and self._airborne
            and (landed or not to_ground),
            landed=landed,
            tipped=tilt_deg is not None and not tilt_deg <= TIPPED_DEG,
            max_cross_track_m=self._cross_track_m,
            altitude_error_m=altitude_m,
            final_error_m=final_error_m,
            landing_speed_mps=self._landing_speed_mps,
            landed_tilt_deg=tilt_deg,
            called_for=self._called_for(to_ground),
            take_off_missed=self._take_off.missed,
            hold_missed=hold_missed,
            speed_missed="" if self._speeds is None else self._speeds.missed,
            landing_missed=self._landings.missed(self._waypoint),
            endless_item=self._endless_item,
        )

    def _called_for(self, to_ground: bool) -> frozenset[str]:
        """Return the names of the measurements that this plan must yield."""
        names: set[str] = set()
        if self._last_leg is not None and self._endless_item is None:
            names.add("final_error_m")
        if to_ground:
            names |= {"landing_speed_mps", "landed_tilt_deg"}
        if self._fly_legs:
            names.add("max_cross_track_m")
        first = 0 if len(self._fly_legs) == 1 else 1
        for i in range(first, len(self._fly_legs)):
            # The count leaves a leg when it is within reach of the end.
            if leg_length_m(self._fly_legs[i]) - self._reaches_m[i] > self._heights.settle_m[i]:
                names.add("altitude_error_m")
        return frozenset(names)


def horizontal_distance_m(p_W: Vec3, leg: Leg) -> float:
    """Return the horizontal distance from a point to the nearest point of a leg [m].

    s = clamp((p - a).(b - a) / |b - a|^2, 0, 1), d = |p - a - s (b - a)|, all in x and y.
    """
    ax, ay, _ = leg.start_W
    bx, by = leg.end_W[0] - ax, leg.end_W[1] - ay
    px, py = p_W[0] - ax, p_W[1] - ay
    squared = bx * bx + by * by
    s = min(1.0, max(0.0, (px * bx + py * by) / squared)) if squared > 0.0 else 0.0
    dx, dy = px - s * bx, py - s * by
    return math.sqrt(dx * dx + dy * dy)


def reaches_m(fly: Sequence[Leg], limits: Limits) -> list[float]:
    """Return for every leg to a waypoint the horizontal distance [m] from its end at which it counts as reached.

    At one place again, the legs before and after it meet. The waypoints of a plan that stays there have no such legs.
    """
    margin_m = _margin_m(limits)
    before_m, after_m = _lengths_so_far_m(fly), _lengths_so_far_m(fly[::-1])[::-1]
    found_m: list[float] = []
    for i, leg in enumerate(fly):
        longer_m = max(before_m[i], after_m[i + 1] if i + 1 < len(fly) else 0.0) or math.inf
        radius_m = leg.acceptance_radius_m
        near_m = max(radius_m + min(REACH_MARGIN_M, longer_m / 8), min(radius_m + margin_m, 0.5 * longer_m))
        found_m.append(min(near_m, max(radius_m + UNJUDGED_M, 0.5 * leg_length_m(leg))))
    return found_m


def _margin_m(limits: Limits) -> float:
    """Return the horizontal distance [m] by which a vehicle may be off its place."""
    return max(REACH_MARGIN_M, UNJUDGED_M if limits.max_cross_track_m is None else limits.max_cross_track_m)


def landing_reach_m(limits: Limits) -> float:
    """Return the horizontal distance [m] from its place within which a landing in the middle of a plan counts."""
    return ACCEPTANCE_RADIUS_M + min(_margin_m(limits), UNJUDGED_M)


def top_reach_m(climb: Leg) -> float:
    """Return the distance [m] from the end of a take-off within which the vehicle waits there.

    Some autopilots climb above the start, others on the straight line.
    """
    return climb.acceptance_radius_m + REACH_MARGIN_M + leg_length_m(climb)


def _lengths_so_far_m(legs: Sequence[Leg]) -> list[float]:
    """Return for every leg its length [m], or that of the last leg before it that leads to another place; 0: none."""
    lengths_m: list[float] = []
    for leg in legs:
        so_far_m = lengths_m[-1] if lengths_m else 0.0
        lengths_m.append(leg_length_m(leg) if leg_length_m(leg) > STILL_M else so_far_m)
    return lengths_m


def _greater(so_far: float | None, value: float) -> float:
    """Return the greater value. A NaN of either stays."""
    if so_far is None:
        return value
    return value if not value <= so_far and so_far == so_far else so_far


_WHY_NOT_MEASURED = {
    "max_cross_track_m": "the vehicle flew no leg between waypoints",
    "altitude_error_m": "the vehicle flew no level leg",
    "final_error_m": "the vehicle did not end on the ground",
    "landing_speed_mps": "the vehicle did not touch down",
    "landed_tilt_deg": "the vehicle did not touch down",
}


def judge(measured: Measurements, limits: Limits, *, outcome: Outcome = "complete") -> Verdict:
    """Return the verdict on how a plan was flown under these limits.

    `outcome`: required end of the flight. If the plan need not be completed, a limit without a measurement is not
    judged; of a flight that shall crash, no limit is: the fall misses them all.
    """
    called_for = measured.called_for if outcome == "complete" else frozenset[str]()
    reasons: list[str] = []
    if called_for and not measured.completed:
        if measured.endless_item is not None:
            reasons.append(f"the mission never ends: item {measured.endless_item + 1} jumps back for ever")
        elif measured.reached < measured.waypoints:
            missed = f"; {measured.landing_missed}" if measured.landing_missed else ""
            reasons.append(f"reached {measured.reached} of {measured.waypoints} waypoints{missed}")
        elif measured.take_off_missed or measured.hold_missed:
            reasons.append(measured.take_off_missed or measured.hold_missed)
        else:
            reasons.append("the mission was not finished: the vehicle did not end on the ground")
    if outcome == "complete" and measured.speed_missed:
        reasons.append(measured.speed_missed)
    if outcome == "aborted" and measured.completed:
        reasons.append("the mission was completed, but the script expects that it is not (outcome: aborted)")
    rows: list[Row] = []
    for name in Limits.model_fields:
        value = getattr(measured, name)
        limit = None if outcome == "crashed" else getattr(limits, name)
        unit = unit_of(name).strip()
        ok = True
        if limit is not None and value is not None:
            ok = value <= limit  # False for NaN
            if not ok:
                reasons.append(f"{name} is {value:.3g} {unit}, more than the {limit:g} {unit} allowed")
        elif limit is not None and name in called_for:
            ok = False
            reasons.append(f"{name} has a limit of {limit:g} {unit} but was never measured: {_WHY_NOT_MEASURED[name]}")
        rows.append(Row(name, value, limit, unit, ok))
    return Verdict(rows, reasons)
