"""Judges the flight of a VTOL, from ground truth: as a plane while its wings carry it, as a multirotor in hover.

What carries it is taken from the true speeds of its rotors and the true angles of its tilts. Share: the sum of
k O^2 cos(tilt) of the lifters over that in hover; a lifter that a tilt has turned by 90 degrees lifts nothing. A
tailsitter's nose tells it (`tail.py`): the 3 s before it is lowered, or rises, belong to the transition. Height is lost
from the greatest height of that time, and airspeed, bank and drift do not count in it.

on the wings    the share is below 0.1
transition      to the wings from the moment at which the pusher turns at a tenth of its full speed, or all tilts have
                gone a tenth of their way ahead, until 5 s after the wings have taken over; back from the moment at
                which the share rises over 0.1, until the vehicle is slower than 5 m/s over ground, or for 10 s
hover           all other time in the air

As of a plane (`plane_limits`): waypoints flown to on the wings, max_cross_track_m, altitude_error_m and loiter_error_m,
of which errors count on the wings alone, airspeed_margin and max_bank_deg. As of a multirotor (`limits`): waypoints in
hover (their height as on the wings), final_error_m, landing_speed_mps and landed_tilt_deg. Its own:

transition_loss_m    greatest height lost since the beginning of a transition (`vtol_limits`)
landings             those in the middle of the plan, as of a multirotor
holds                times to wait in hover, each flown before what follows counts, as of a multirotor
hover_cross_track_m  in hover (`limits.max_cross_track_m`): greatest horizontal distance from the start before the first
                     transition, and from the straight legs to waypoints in hover, from where a waypoint counts as
                     reached; the first leg after a transition is left out
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

from hil.config.missions.path import Leg, LegKind
from hil.config.missions.places import LOITER_RADII
from hil.config.missions.regimes import on_wings
from hil.config.schema import Limits, PlaneLimits
from hil.run.verdict.flight import (
    REACH_MARGIN_M,
    FlightMeasurement,
    horizontal_distance_m,
    landing_reach_m,
    reaches_m,
    top_reach_m,
)
from hil.run.verdict.flyable_path import Stop
from hil.run.verdict.hold import LESS_HOLD_S, Hold
from hil.run.verdict.landings import Landings
from hil.run.verdict.plane_flight import Flow, PlaneMeasurement, Stall
from signals.mission import MissionItem
from signals.rotation import cos_tilt_of
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S

_ON_WINGS = 0.1  # share of the lift in hover
_TURNS = 0.1  # share of the pusher's full speed, or of a tilt's way ahead
_AFTER_FRONT_NS, _BACK_NS = 5 * NS_PER_S, 10 * NS_PER_S
_SLOW_MPS = 5.0
_OF_PLANE = ("max_cross_track_m", "altitude_error_m", "airspeed_margin", "stalled_s", "max_bank_deg", "loiter_error_m")
_OF_HOVER = ("final_error_m", "landing_speed_mps", "landed_tilt_deg")
_WAYPOINT = 16


class Carriage(Protocol):
    """Tells what carries a VTOL; asked at every measured tick, in order."""

    @property
    def looks_back_s(self) -> float:
        """Time from the beginning of a transition until it is seen."""

    def on_wings(self, truth: TruthState) -> bool:
        """Return True while the wings carry it."""

    def ahead(self, truth: TruthState) -> bool:
        """Return True if it pulls ahead: a transition has begun, or the wings carry it."""

    def cos_tilt(self, q_WB: Quat) -> float:
        """Return the cosine of the angle between what is up in hover and the vertical."""


@dataclass(frozen=True)
class Rotors:
    """Speeds of rotors and angles of tilts that tell what carries the vehicle."""

    lifters: Sequence[int]
    pushers: Sequence[int]
    hover_radps: Sequence[float]  # of each lifter
    full_radps: Sequence[float]  # of each pusher
    ahead_rad: Sequence[float] = ()  # of each tilt, where its rotors point most ahead; the tilts lead the servos
    tilt_of: Sequence[int | None] = ()  # of each lifter, the tilt that turns it; without tilts empty
    looks_back_s: float = 0.0

    def on_wings(self, truth: TruthState) -> bool:
        """Return True while no lifter carries it."""
        return self.share(truth) < _ON_WINGS

    def cos_tilt(self, q_WB: Quat) -> float:
        """Return the cosine of the angle between the vehicle's z axis and the vertical."""
        return cos_tilt_of(q_WB)

    def share(self, truth: TruthState) -> float:
        """Return the mean of (O / O_hover)^2 of the lifters, of what still points up."""
        speeds_radps, tilt_of = truth.rotor_speed_radps, self.tilt_of or [None] * len(self.lifters)
        lifts = [
            (speeds_radps[i] / hover) ** 2 * (1.0 if tilt is None else max(math.cos(truth.surface_rad[tilt]), 0.0))
            for i, hover, tilt in zip(self.lifters, self.hover_radps, tilt_of, strict=True)
        ]
        return sum(lifts) / len(lifts)

    def ahead(self, truth: TruthState) -> bool:
        """Return True if a pusher turns, or all tilts are on their way: one alone may steer."""
        pairs = zip(self.pushers, self.full_radps, strict=True)
        if any(truth.rotor_speed_radps[i] > _TURNS * full for i, full in pairs):
            return True
        angles = zip(truth.surface_rad, self.ahead_rad, strict=False)
        return bool(self.ahead_rad) and all(angle / ahead > _TURNS for angle, ahead in angles)


class _Phase(Enum):
    HOVER = auto()
    FRONT = auto()
    WINGS = auto()
    BACK = auto()


def flown_items(items: Sequence[MissionItem], params: Mapping[str, float]) -> list[MissionItem]:
    """Return the items with loiters in hover as waypoints: there is no circle about them."""
    return [
        item._replace(command=_WAYPOINT) if item.command in LOITER_RADII and not wings else item
        for item, wings in zip(items, on_wings(items, params), strict=True)
    ]


class VtolMeasurement(PlaneMeasurement):
    """Measures the flight of a VTOL tick by tick."""

    def __init__(
        self,
        legs: Sequence[Leg],
        stops: Sequence[Stop],
        limits: tuple[PlaneLimits, Limits],
        carriage: Carriage,
        *,
        wings: Set[int],
        radius_m: float,
        stall: Stall,
        wind_at: Callable[[], Vec3],
    ) -> None:
        """`wings`: numbers of the items that are flown on the wings, and of the take-offs that lead to them."""
        super().__init__(
            legs,
            stops,
            limits[0],
            radius_m=radius_m,
            stall=stall,
            wind_at=wind_at,
        )
        self._landing = FlightMeasurement(legs[-1:], limits[1], cos_tilt=carriage.cos_tilt)
        self._carriage, self._wings = carriage, wings
        waypoints = [stop.leg for stop in self._stops if stop.leg is not None]
        self._reaches_m = reaches_m(waypoints, limits[1])  # in hover
        self._looks_back_ns = round(carriage.looks_back_s * NS_PER_S)
        self._heights: deque[tuple[int, float]] = deque()  # time and height, back to there
        # Not counted yet: what a transition begins with is a part of it.
        self._flows: deque[Flow] = deque()
        self._drifts: deque[tuple[int, float]] = deque()  # time, distance in hover
        self._phase = _Phase.HOVER
        self._phase_ns = 0
        self._transited = False
        self._from_m = 0.0  # height at the beginning of the transition
        self._wings_ns: int | None = None
        self._start: tuple[float, float] | None = None
        self._in_hover = True  # the newest waypoint was reached in hover, or none yet
        # Places to wait in hover, by the number of waypoints reached until then, and the reach of each.
        climbs = [(leg, top_reach_m(leg)) for leg in legs if leg.kind is LegKind.CLIMB][:1]
        self._places = dict(enumerate(climbs)) | dict(enumerate(zip(waypoints, self._reaches_m, strict=True), start=1))
        self._landings = Landings(legs, reach_m=landing_reach_m(limits[1]))
        self._holds = {
            number: Hold(leg.wait_s)
            for number, (leg, _) in self._places.items()
            if leg.seq not in wings and leg.wait_s > LESS_HOLD_S
        }

    def add(self, truth: TruthState) -> None:
        self._landing.add(truth)
        super().add(truth)

    def _on_wings(self, truth: TruthState) -> bool:
        """Follow the phases, at every measured tick above 5 m."""
        wings, pushes = self._carriage.on_wings(truth), self._carriage.ahead(truth)
        up = truth.p_WB[2]
        self._remember(truth.t_ns, up)
        if self._phase is _Phase.HOVER and pushes:
            self._begin(_Phase.FRONT, truth)
            self._wings_ns = None
        elif self._phase is _Phase.FRONT:
            self._front(truth, wings=wings, pushes=pushes)
        elif self._phase is _Phase.WINGS and not wings:
            self._begin(_Phase.BACK, truth)
        elif self._phase is _Phase.BACK:
            slow = math.hypot(truth.v_WB_W[0], truth.v_WB_W[1]) < _SLOW_MPS
            if (slow and not wings) or truth.t_ns - self._phase_ns > _BACK_NS:
                self._phase = _Phase.WINGS if wings else _Phase.HOVER
        if self._phase in (_Phase.FRONT, _Phase.BACK):
            self._most("transition_loss_m", max(self._from_m - up, 0.0))
        if self._phase is _Phase.HOVER:
            self._hover(truth)
        while self._drifts and self._drifts[0][0] <= truth.t_ns - self._looks_back_ns:
            self._most("hover_cross_track_m", self._drifts.popleft()[1])
        return wings

    def _remember(self, t_ns: int, up_m: float) -> None:
        heights = self._heights
        heights.append((t_ns, up_m))
        while heights[0][0] < t_ns - self._looks_back_ns:
            heights.popleft()

    def _measure_flow(self, truth: TruthState, seconds: float) -> None:
        self._flows.append(self._flow(truth, seconds))
        while self._flows and self._flows[0].t_ns <= truth.t_ns - self._looks_back_ns:
            self._count_flow(self._flows.popleft())

    def _begin(self, phase: _Phase, truth: TruthState) -> None:
        self._flows.clear()
        self._drifts.clear()
        self._phase, self._phase_ns, self._from_m = phase, truth.t_ns, max(height for _, height in self._heights)
        self._transited, self._in_hover = True, False

    def _front(self, truth: TruthState, *, wings: bool, pushes: bool) -> None:
        if wings and self._wings_ns is None:
            self._wings_ns = truth.t_ns
        if self._wings_ns is None:
            if not pushes:
                self._phase = _Phase.HOVER  # given up
        elif not wings:
            self._begin(_Phase.BACK, truth)
        elif truth.t_ns - self._wings_ns > _AFTER_FRONT_NS:
            self._phase = _Phase.WINGS

    def _hover(self, truth: TruthState) -> None:
        place = (truth.p_WB[0], truth.p_WB[1])
        self._start = self._start or place
        target = self._reached
        if target >= len(self._targets):
            return
        leg = self._stops[self._targets[target]].leg
        assert leg is not None
        if target == 0 and not self._transited and leg.seq in self._wings:
            self._drifts.append((truth.t_ns, math.dist(place, self._start)))
        elif self._in_hover:
            # The count is ahead of the vehicle by the distance at which a waypoint counts as reached.
            corner_m = self._reaches_m[target - 1] if target else leg.acceptance_radius_m + REACH_MARGIN_M
            if math.dist(place, leg.start_W[:2]) > corner_m:
                self._drifts.append((truth.t_ns, horizontal_distance_m(truth.p_WB, leg)))

    def _follow(self, p: Vec3, seconds: float) -> None:
        before = self._reached
        if before in self._holds:
            leg, reach_m = self._places[before]
            if math.dist(p[:2], leg.end_W[:2]) <= reach_m and self._level_with(leg, p[2]):
                self._holds[before].add(round(seconds * NS_PER_S))
        super()._follow(p, seconds)
        if self._reached != before:
            self._in_hover = self._phase is _Phase.HOVER

    def unflown(self) -> str:
        hold = self._holds.get(self._reached)
        if hold is not None and hold.missed:
            return hold.text(self._reached)
        return super().unflown()

    def _near(self, stop: Stop, leg: Leg, distance: float, along: float) -> bool:
        if leg.seq in self._wings:
            return super()._near(stop, leg, distance, along)
        return distance <= self._reaches_m[self._reached]

    def _error(self, target: int, place: tuple[float, float]) -> None:
        if self._phase is _Phase.WINGS:
            super()._error(target, place)

    # -- after the flight ---------------------------------------------------------------------------------------

    def values(self) -> dict[str, float | None]:
        while self._flows:
            self._count_flow(self._flows.popleft())
        while self._drifts:
            self._most("hover_cross_track_m", self._drifts.popleft()[1])
        found = super().values()
        landing = self._landing.result()
        of_hover = {name: getattr(landing, name) for name in _OF_HOVER}
        own = {name: self._values.get(name) for name in ("transition_loss_m", "hover_cross_track_m")}
        return {name: found[name] for name in _OF_PLANE} | of_hover | own

    def called_for(self) -> frozenset[str]:
        names = set(super().called_for()) & set(_OF_PLANE) if self._wings else set()
        if self._wings:
            names.add("transition_loss_m")
        return frozenset(names | (self._landing.result().called_for & set(_OF_HOVER)))
