"""Judges the flight of a plane against its plan and its own limits (`plane_limits`), from ground truth.

reached             Waypoints count in order. One is reached when the true position comes, horizontally, within the
                    greatest of its acceptance radius, the distance R tan(45 deg) + 20 m at which a fly-by turn begins,
                    and for a loiter 1.25 times its radius; or when the plane has passed it, within three times that
                    distance. Vertically within `altitude_error_m`, at least 10 m
max_cross_track_m   Greatest horizontal distance from the path that a plane can fly through the waypoints
                    (`flyable_path.py`), from the first waypoint reached to the last, and on the approach
altitude_error_m    Greatest |z - planned z| on level legs that follow a level leg
airspeed_margin     Least airspeed over the stall speed at the load of the bank, V / (V_stall / sqrt(cos bank)), while
                    higher than 5 m over the start. 1 is the stall
max_bank_deg        Greatest bank while higher than 5 m
loiter_error_m      Greatest |distance from the centre - radius| on a loiter's circle, from the first time within 10 %
                    of the radius until it is left
touchdown_sink_mps  Downward speed in the tick before the first contact of the last landing
touchdown_bank_deg  Bank at that contact
touchdown_offset_m  Distance of that contact from the line of the approach, which is a runway's centre line where the
                    plan lands on one
touchdown_error_m   Distance of that contact from the planned point along that line
final_error_m       Horizontal distance of that contact from the planned point; of the last place, without a landing
takeoff_roll_m, landing_roll_m, centre_line_m, off_runway_m
                    On wheels, on a runway: `runway_rolls.py`

A limit fails if its value is NaN, or if the plan calls for the measurement and the flight did not yield it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from hil.config.missions.path import Leg, LegKind
from hil.config.missions.script import Outcome
from hil.config.schema import PlaneLimits
from hil.run.verdict.flyable_path import FlyablePath, Stop
from hil.run.verdict.runway_rolls import RunwayRolls
from hil.run.verdict.verdict import AIRBORNE_M, REST_CONTACT_NS, REST_SPEED_MPS, Row, Verdict
from signals.documents.validate import unit_of
from signals.rotation import matrix_of
from signals.samples import TruthState, Vec3

_STRIDE = 10  # ticks
_JUDGED_M = 5.0  # height over the start from which airspeed and bank count
_REACH_EXTRA_M, _REACH_HEIGHT_M = 20.0, 10.0
_PASSED = 3.0  # times the distance
_LEVEL_M = 0.5
_ON_CIRCLE = 0.1
_COMMITTED_RAD = math.radians(50.0)
_MINIMA = frozenset({"airspeed_margin"})


class PlaneMeasurement:
    """Measures the flight of a plane tick by tick."""

    def __init__(
        self,
        legs: Sequence[Leg],
        stops: Sequence[Stop],
        limits: PlaneLimits,
        *,
        radius_m: float,
        stall_mps: float,
        wind_at: Callable[[], Vec3],
        rolls: RunwayRolls | None = None,
    ) -> None:
        """`radius_m`: of the turns of the flyable path. `wind_at` returns the wind at the vehicle in W.

        `rolls` measures those on a runway; None: the plane has no wheels, or the scene has no runway.
        """
        self._rolls = rolls
        self._path = FlyablePath(stops, radius_m)
        self._stops = self._path.stops
        self._targets = [i for i, stop in enumerate(self._stops) if stop.leg is not None]
        self._reach_m = radius_m + _REACH_EXTRA_M
        self._height_m = max(_REACH_HEIGHT_M, limits.altitude_error_m or 0.0)
        self._stall_mps, self._wind_at = stall_mps, wind_at
        self._last_leg = legs[-1] if legs else None
        self._lands = self._last_leg is not None and self._last_leg.kind is LegKind.DESCENT
        # A return lands on a line of the autopilot's own choice.
        self._approaches = self._lands and len(self._stops) > 1 and self._stops[-1].leg is None
        self.endless_item = legs[-1].seq if legs and legs[-1].kind is LegKind.ENDLESS else None
        self._reached = 0
        self._values: dict[str, float] = {}
        self._home_up: float | None = None
        self._airborne = self._touched = False
        self._contact, self._contact_ns = True, 0
        self._touch: TruthState | None = None
        self._previous: TruthState | None = None
        self._circling = False
        self._bearing = self._turned = 0.0
        self._pending: list[tuple[float, float]] = []  # angle turned on the circle, error there

    @property
    def counts(self) -> tuple[int, int]:
        """Waypoints reached so far, and waypoints of the plan."""
        return self._reached, len(self._targets)

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        previous, self._previous = self._previous, truth
        if self._rolls is not None:
            self._rolls.add(truth)
        contact = truth.in_contact
        if contact:
            self._contact_ns = truth.t_ns
            if not self._contact and self._airborne and not self._touched and previous is not None:
                self._touched, self._touch = True, previous
        self._contact = contact
        if truth.tick % _STRIDE == 0:
            self._measure(truth)

    def _measure(self, truth: TruthState) -> None:
        up = truth.p_WB[2]
        if self._home_up is None:
            self._home_up = up
        height = up - self._home_up
        if not truth.in_contact and height > AIRBORNE_M:
            self._airborne = True
        if height <= _JUDGED_M or truth.in_contact:
            return
        if self._touched:  # took off again: the next touch-down counts
            self._touched = False
        w = self._wind_at()
        v = truth.v_WB_W
        airspeed = math.dist(v, w)
        bank = bank_rad(truth)
        load = 1.0 / max(math.cos(bank), 0.1)
        self._least("airspeed_margin", airspeed / (self._stall_mps * math.sqrt(load)))
        self._most("max_bank_deg", abs(math.degrees(bank)))
        if self._airborne:
            self._follow(truth.p_WB)

    def _follow(self, p: Vec3) -> None:
        """Count waypoints, and measure against the path."""
        place = (p[0], p[1])
        self._loiter(place)
        if self._reached >= len(self._targets):
            if self._approaches and self._targets:
                self._error(len(self._stops) - 1, place)
            return
        target = self._targets[self._reached]
        stop = self._stops[target]
        assert stop.leg is not None
        if self._reached:
            self._error(target, place)
            before = self._stops[self._targets[self._reached - 1]].leg
            assert before is not None
            level = abs(stop.leg.end_W[2] - stop.leg.start_W[2]) < _LEVEL_M
            if level and abs(before.end_W[2] - before.start_W[2]) < _LEVEL_M:
                self._most("altitude_error_m", abs(p[2] - stop.leg.end_W[2]))
        reach = max(stop.leg.acceptance_radius_m, self._reach_m, 1.25 * abs(stop.loiter_m))
        distance = math.dist(place, stop.place)
        start = stop.leg.start_W
        along = (p[0] - stop.place[0]) * (stop.place[0] - start[0]) + (p[1] - stop.place[1]) * (
            stop.place[1] - start[1]
        )
        passed = along > 0.0 and distance <= _PASSED * reach
        if (distance <= reach or passed) and abs(p[2] - stop.leg.end_W[2]) <= self._height_m:
            self._reached += 1
            self._circling = False

    def _error(self, target: int, place: tuple[float, float]) -> None:
        error = self._path.error_m(target, place)
        if error is not None:
            self._most("max_cross_track_m", error)

    def _loiter(self, place: tuple[float, float]) -> None:
        """Measure the circle about the waypoint reached last, or the way on from it, whichever is nearer."""
        stop = self._stops[self._targets[self._reached - 1]] if self._reached else None
        if stop is None or not stop.loiter_m:
            return
        radius = abs(stop.loiter_m)
        bearing = math.atan2(place[1] - stop.place[1], place[0] - stop.place[0])
        off = abs(math.dist(place, stop.place) - radius)
        circling = off <= (0.5 if self._circling else _ON_CIRCLE) * radius
        if not circling or not self._circling:
            self._turned, self._pending = 0.0, []
        else:
            self._turned += abs(math.remainder(bearing - self._bearing, math.tau))
        self._circling, self._bearing = circling, bearing
        if not circling:
            return
        # A plane that leaves on a tangent is half a radius off before it has gone on by 50 degrees: what it errs from
        # there on is no error.
        self._pending.append((self._turned, off))
        while self._pending and self._pending[0][0] < self._turned - _COMMITTED_RAD:
            self._most("loiter_error_m", self._pending.pop(0)[1])

    def _most(self, name: str, value: float) -> None:
        """Keep the greatest value; NaN stays."""
        so_far = self._values.get(name)
        if so_far is None or not (value <= so_far or so_far != so_far):
            self._values[name] = value

    def _least(self, name: str, value: float) -> None:
        """Keep the least value; NaN stays."""
        so_far = self._values.get(name)
        if so_far is None or not (value >= so_far or so_far != so_far):
            self._values[name] = value

    # -- after the flight ---------------------------------------------------------------------------------------

    @property
    def landed(self) -> bool:
        """True if the vehicle rests on the ground after a flight."""
        last = self._previous
        if last is None or not self._touched:
            return False
        return math.hypot(*last.v_WB_W) <= REST_SPEED_MPS and last.t_ns - self._contact_ns <= REST_CONTACT_NS

    @property
    def completed(self) -> bool:
        """True if all waypoints were reached, and the plan's end."""
        all_reached = self._reached == len(self._targets)
        known = self._last_leg is not None and self.endless_item is None
        return known and all_reached and self._airborne and (self.landed or not self._lands)

    def values(self) -> dict[str, float | None]:
        """Return every measurement by name; None: the flight did not yield it."""
        found: dict[str, float | None] = {name: self._values.get(name) for name in PlaneLimits.model_fields}
        end = self._last_leg.end_W if self._last_leg is not None else None
        touch = self._touch if self._touched else None
        if touch is not None:
            found["touchdown_sink_mps"] = -touch.v_WB_W[2]
            found["touchdown_bank_deg"] = abs(math.degrees(bank_rad(touch)))
        if touch is not None and end is not None and self._approaches:
            before, (x, y) = self._stops[-2].place, self._stops[-1].place
            length = max(math.dist(before, (x, y)), 1e-9)
            t = ((x - before[0]) / length, (y - before[1]) / length)
            dx, dy = touch.p_WB[0] - x, touch.p_WB[1] - y
            found["touchdown_offset_m"] = abs(t[0] * dy - t[1] * dx)
            found["touchdown_error_m"] = abs(t[0] * dx + t[1] * dy)
        if self._rolls is not None:
            found |= self._rolls.values()
        last = touch or self._previous
        if last is not None and end is not None and self._airborne and (self.landed or not self._lands):
            found["final_error_m"] = math.dist(last.p_WB[:2], end[:2])
        return found

    def called_for(self) -> frozenset[str]:
        """Return the names of the measurements that this plan must yield."""
        names = {"airspeed_margin", "max_bank_deg"} if self._last_leg is not None else set()
        if self._lands:
            names |= {"touchdown_sink_mps", "touchdown_bank_deg", "final_error_m"}
            if self._approaches:
                names |= {"touchdown_offset_m", "touchdown_error_m"}
        if len(self._targets) > 1:
            names.add("max_cross_track_m")
        if self._rolls is not None and self._last_leg is not None:
            names |= self._rolls.called_for()
        return frozenset(names)


def bank_rad(truth: TruthState) -> float:
    """Return the bank: the angle of the body's y axis under the horizontal, right wing down positive."""
    R = matrix_of(truth.q_WB)
    return math.atan2(R[7], R[8])


def judge_plane(measured: PlaneMeasurement, limits: PlaneLimits, *, outcome: Outcome = "complete") -> Verdict:
    """Return the verdict on how a plane flew its plan under these limits; `outcome` as in `verdict.judge`."""
    called_for = measured.called_for() if outcome == "complete" else frozenset[str]()
    reasons: list[str] = []
    reached, waypoints = measured.counts
    if called_for and not measured.completed:
        if measured.endless_item is not None:
            reasons.append(f"the mission never ends: item {measured.endless_item + 1} jumps back for ever")
        elif reached < waypoints:
            reasons.append(f"reached {reached} of {waypoints} waypoints")
        else:
            reasons.append("the mission was not finished: the plane did not end on the ground")
    if outcome == "aborted" and measured.completed:
        reasons.append("the mission was completed, but the script expects that it is not (outcome: aborted)")
    rows: list[Row] = []
    for name, value in measured.values().items():
        limit = None if outcome == "crashed" else getattr(limits, name)
        unit = unit_of(name).strip()
        ok = True
        if limit is not None and value is not None:
            least = name in _MINIMA
            ok = value >= limit if least else value <= limit  # False for NaN
            if not ok:
                how = "less than the required" if least else "more than the allowed"
                reasons.append(f"{name} is {value:.3g} {unit}, {how} {limit:g} {unit}".replace(" ,", ",").rstrip())
        elif limit is not None and name in called_for:
            ok = False
            reasons.append(f"{name} has a limit of {limit:g} {unit}".rstrip() + " but was never measured")
        rows.append(Row(name, value, limit, unit, ok))
    return Verdict(rows, reasons)
