"""Judges the flight of a plane against its plan and its own limits (`plane_limits`), from ground truth.

reached             Waypoints count in order. One is reached when the true position comes, horizontally, within the
                    greatest of its acceptance radius, the distance R tan(45 deg) + 20 m at which a fly-by turn begins,
                    and for a loiter 1.25 times its radius; or when the plane has passed it, within three times that
                    distance, and flies on to another. Vertically within `altitude_error_m`, at least 10 m and at
                    most the greater of 10 m and half of its height. What follows a loiter counts once its turns (but a
                    quarter) or its time (but 2 s) have been flown, near its circle and in its direction
max_cross_track_m   Greatest horizontal distance from the path that a plane can fly through the waypoints
                    (`flyable_path.py`), from the first waypoint reached to the last, and on the approach
altitude_error_m    Greatest distance of z from the heights between the ends of the leg being flown (and those of the
                    legs before it, as far as the count is ahead), if it and the one before slope by less than `_SLOPE`
airspeed_margin     Least airspeed over the stall speed at the load of the bank, V / (V_stall / sqrt(cos bank)), while
                    higher than 5 m over the start. 1 is the stall
stalled_s           Time with an angle of attack beyond that of the stall, upright or inverted, while higher than 5 m
max_bank_deg        Greatest bank while higher than 5 m
loiter_error_m      Greatest |distance from the centre - radius| on a loiter's circle, from the first time within 10 %
                    of the radius until it is left
touchdown_sink_mps  Greatest downward speed in the tick before a contact, from the first one of the last landing on
touchdown_bank_deg  Bank at the first contact
touchdown_offset_m  Distance of that contact from the line of the approach, which is a runway's centre line where the
                    plan lands on one
touchdown_error_m   Distance of that contact from the planned point along that line; after a return, from home
final_error_m       Horizontal distance of that contact from the planned point; of the last place, without a landing
takeoff_roll_m, landing_roll_m, centre_line_m, off_runway_m
                    On wheels, on a runway: `runway_rolls.py`

landings            What follows a landing in the middle of the plan counts once the plane has come to rest within
                    `touchdown_error_m` and a roll of its place, and has climbed again; meanwhile nothing is measured
                    against the plan

A plane that touches the ground elsewhere before its last waypoint, once higher than 5 m or launched, has not flown its
plan. A limit fails if its value is NaN, or if the plan calls for the measurement and the flight did not yield it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from hil.config.missions.path import WINGS_REACH_M, Leg, LegKind
from hil.config.missions.script import Outcome
from hil.config.schema import PlaneLimits
from hil.run.verdict.air_data import air_data
from hil.run.verdict.flyable_path import FlyablePath, Stop
from hil.run.verdict.landings import Landings
from hil.run.verdict.leg_heights import bands_m, leg_length_m
from hil.run.verdict.runway_rolls import RunwayRolls
from hil.run.verdict.take_off_height import TakeOffHeight
from hil.run.verdict.verdict import AIRBORNE_M, REST_CONTACT_NS, REST_SPEED_MPS, Row, Verdict
from signals.documents.validate import unit_of
from signals.rotation import matrix_of
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S

_STRIDE = 10  # ticks
_JUDGED_M = 5.0  # height over the start from which airspeed and bank count
_REACH_HEIGHT_M = 10.0
_PASSED = 3.0  # times the distance
_LEVEL_M, _SLOPE = 0.5, 0.02  # between the ends of a leg that counts as level: the greater of both
_ON_CIRCLE = 0.1
_COMMITTED_RAD = math.radians(50.0)
_NEAR_CIRCLE = 0.5  # of the radius
_LESS_TURNS, _LESS_S = 0.25, 2.0  # of a loiter: autopilots begin to count before the circle is reached
_LEAST_FLOW_MPS = 3.0
_CLIMBED_M = 1.0  # below the end of a climb it is over
_UNJUDGED_M, _ROLL_M = 100.0, 200.0  # from the place of a landing in the middle of a plan to where it ends
_MINIMA = frozenset({"airspeed_margin"})


class Stall(NamedTuple):
    """Least airspeed of level flight, and the angle of attack beyond which the wing has stalled."""

    speed_mps: float
    attack_rad: float = math.inf


class Flow(NamedTuple):
    """Flow past the vehicle in one tick."""

    t_ns: int
    airspeed_margin: float
    bank_deg: float
    stalled_s: float  # time since the tick before, if stalled


class PlaneMeasurement:
    """Measures the flight of a plane tick by tick."""

    def __init__(
        self,
        legs: Sequence[Leg],
        stops: Sequence[Stop],
        limits: PlaneLimits,
        *,
        radius_m: float,
        stall: Stall,
        launched: bool = False,
        wind_at: Callable[[], Vec3],
        rolls: RunwayRolls | None = None,
    ) -> None:
        """`radius_m`: of the turns of the flyable path. `launched`: from a rail, not from wheels.

        `wind_at` returns the wind at the vehicle in W. `rolls` measures those on a runway; None: the plane has no
        wheels, or the scene has no runway.
        """
        self._rolls = rolls
        self._path = FlyablePath(stops, radius_m)
        self._stops = self._path.stops
        self._targets = [i for i, stop in enumerate(self._stops) if stop.leg is not None]
        self._reach_m = radius_m + WINGS_REACH_M
        fly = [stop.leg for stop in self._stops if stop.leg is not None]
        self._level = [abs(leg.end_W[2] - leg.start_W[2]) < max(_LEVEL_M, _SLOPE * leg_length_m(leg)) for leg in fly]
        self._heights_m = bands_m(fly, [max(leg.acceptance_radius_m, self._reach_m) for leg in fly], self._level)
        self._height_m = max(_REACH_HEIGHT_M, limits.altitude_error_m or 0.0)
        self._stall, self._wind_at = stall, wind_at
        self._take_off = TakeOffHeight(legs, reach_height_m=self._height_m)
        self._last_leg = legs[-1] if legs else None
        self._lands = self._last_leg is not None and self._last_leg.kind is LegKind.DESCENT
        # A return lands on a line of the autopilot's own choice.
        self._approaches = self._lands and len(self._stops) > 1 and self._stops[-1].leg is None
        self._returns = self._lands and not self._approaches
        error_m, roll_m = limits.touchdown_error_m or _UNJUDGED_M, limits.landing_roll_m or _ROLL_M
        self._landings = Landings(legs, reach_m=error_m + roll_m)
        self.endless_item = legs[-1].seq if legs and legs[-1].kind is LegKind.ENDLESS else None
        self._reached = 0
        self._values: dict[str, float] = {}
        self._home_up: float | None = None
        self._launched, self._airborne, self._touched = launched, False, False
        self._off = False  # the ground for good, until it lands
        self._grounded: tuple[float, int] | None = None  # first contact before the last waypoint: time, waypoint
        self._contact, self._contact_ns = True, 0
        self._touch: TruthState | None = None
        self._previous: TruthState | None = None
        self._measured: TruthState | None = None  # last one measured in flight
        self._circling = False
        self._bearing = self._turned = 0.0
        self._flown_turns = self._flown_s = 0.0  # of the present loiter; turns in its direction are positive
        self._loitered = False
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
        due = self._landings.due
        if due:
            self._landings.add(truth, self._reached)
        contact = truth.in_contact
        if contact:
            self._contact_ns = truth.t_ns
            if not self._contact and self._airborne and previous is not None:
                if not self._touched:
                    self._touched, self._touch = True, previous
                    self._values.pop("touchdown_sink_mps", None)
                self._most("touchdown_sink_mps", -previous.v_WB_W[2])
            early = self._reached < len(self._targets) and self._reached not in due
            if self._off and self._grounded is None and early:
                self._grounded = (truth.t_ns / NS_PER_S, self._reached + 1)
        elif self._launched:
            self._off = True
        self._contact = contact
        if truth.tick % _STRIDE == 0:
            self._measure(truth)

    def _measure(self, truth: TruthState) -> None:
        up = truth.p_WB[2]
        if self._home_up is None:
            self._home_up = up
        height = up - self._home_up
        self._take_off.add(up)
        if not truth.in_contact and height > AIRBORNE_M:
            self._airborne = True
        if height <= _JUDGED_M or truth.in_contact:
            return
        if self._touched:  # took off again: the next touch-down counts
            self._touched = False
        self._off = True
        seconds = _seconds(self._measured, truth)
        self._measured = truth
        if self._on_wings(truth):
            self._measure_flow(truth, seconds)
        if self._airborne:
            self._follow(truth.p_WB, seconds)

    def _measure_flow(self, truth: TruthState, seconds: float) -> None:
        self._count_flow(self._flow(truth, seconds))

    def _flow(self, truth: TruthState, seconds: float) -> Flow:
        air = air_data(truth, self._wind_at())
        bank = bank_rad(truth)
        margin = air.airspeed_mps / stall_at(self._stall.speed_mps, bank)
        stalled = air.airspeed_mps >= _LEAST_FLOW_MPS and not abs(air.attack_rad) <= self._stall.attack_rad
        return Flow(truth.t_ns, margin, abs(math.degrees(bank)), seconds if stalled else 0.0)

    def _count_flow(self, flow: Flow) -> None:
        self._least("airspeed_margin", flow.airspeed_margin)
        self._most("max_bank_deg", flow.bank_deg)
        self._values["stalled_s"] = self._values.get("stalled_s", 0.0) + flow.stalled_s

    def _on_wings(self, truth: TruthState) -> bool:  # noqa: ARG002 (a VTOL asks)
        """Return True while the wings carry the vehicle."""
        return True

    def _follow(self, p: Vec3, seconds: float) -> None:
        """Count waypoints, and measure against the path."""
        place = (p[0], p[1])
        self._loiter(place, seconds)
        if self._landings.due and self._lands_or_climbs(p[2]):
            return
        if self._reached >= len(self._targets):
            if self._approaches and self._targets:
                self._error(len(self._stops) - 1, place)
            return
        target = self._targets[self._reached]
        stop = self._stops[target]
        assert stop.leg is not None
        if self._reached:
            self._error(target, place)
            if self._level[self._reached] and self._level[self._reached - 1]:
                low, high = self._heights_m[self._reached]
                self._most("altitude_error_m", max(low - p[2], p[2] - high, 0.0))
        distance = math.dist(place, stop.place)
        start = stop.leg.start_W
        along = (p[0] - stop.place[0]) * (stop.place[0] - start[0]) + (p[1] - stop.place[1]) * (
            stop.place[1] - start[1]
        )
        near = self._near(stop, stop.leg, distance, along) and self._level_with(stop.leg, p[2])
        if near and not self.unflown():
            self._reached += 1
            self._circling = False
            self._flown_turns, self._flown_s, self._loitered = 0.0, 0.0, False

    def _lands_or_climbs(self, up_m: float) -> bool:
        """Return True from the waypoint before a landing in the middle of the plan until the climb after it is over."""
        places = self._landings.due.get(self._reached)
        if places is None:
            return False
        leg = self._stops[self._targets[self._reached]].leg
        if not places and leg is not None and up_m >= leg.start_W[2] - _CLIMBED_M:
            del self._landings.due[self._reached]
            return False
        return True

    def _level_with(self, leg: Leg, up_m: float) -> bool:
        """Return True at the height of a waypoint: a wide limit of altitude error reaches half way down, no further."""
        half_m = 0.5 * (leg.end_W[2] - (self._home_up or 0.0))
        return abs(up_m - leg.end_W[2]) <= min(self._height_m, max(_REACH_HEIGHT_M, half_m))

    def _near(self, stop: Stop, leg: Leg, distance: float, along: float) -> bool:
        """Return True if a waypoint is reached, or passed: `along` counts past it along its leg."""
        reach = max(leg.acceptance_radius_m, self._reach_m, 1.25 * abs(stop.loiter_m))
        flies_on = self._approaches or self._reached + 1 < len(self._targets)  # and is measured on the way
        return distance <= reach or (flies_on and along > 0.0 and distance <= _PASSED * reach)

    def _error(self, target: int, place: tuple[float, float]) -> None:
        error = self._path.error_m(target, place)
        if error is not None:
            self._most("max_cross_track_m", error)

    def unflown(self) -> str:
        """Return what has to be flown between the waypoint reached last and the next one, and was not; empty: nothing.

        That is a loiter or a landing.
        """
        return self._unflown_loiter() or self._landings.missed(self._reached)

    def _unflown_loiter(self) -> str:
        stop = self._stops[self._targets[self._reached - 1]] if self._reached else None
        if stop is None or not (stop.turns or stop.time_s) or self._loitered:
            return ""
        turned, flown_s = self._flown_turns, self._flown_s
        needed = f"{stop.turns:g} turns" if stop.turns else f"{stop.time_s:g} s"
        back = " the wrong way round" if turned < -_LESS_TURNS else ""
        flown = f"{abs(turned):.1f} turns in {flown_s:.0f} s{back}"
        return f"the loiter at waypoint {self._reached} was not flown: {flown} of {needed}"

    def _loiter(self, place: tuple[float, float], seconds: float) -> None:
        """Measure the circle about the waypoint reached last, or the way on from it, whichever is nearer."""
        stop = self._stops[self._targets[self._reached - 1]] if self._reached else None
        if stop is None or not stop.loiter_m:
            return
        radius = abs(stop.loiter_m)
        bearing = math.atan2(place[1] - stop.place[1], place[0] - stop.place[0])
        off = abs(math.dist(place, stop.place) - radius)
        if off <= _NEAR_CIRCLE * radius:
            change = math.remainder(bearing - self._bearing, math.tau) if self._flown_s else 0.0
            self._flown_turns -= math.copysign(1.0, stop.loiter_m) * change / math.tau
            self._flown_s += seconds
        enough = self._flown_turns >= stop.turns - _LESS_TURNS and self._flown_s >= stop.time_s - _LESS_S
        self._loitered = self._loitered or enough
        circling = off <= (_NEAR_CIRCLE if self._circling else _ON_CIRCLE) * radius
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
        whole = all_reached and not self.take_off_missed and not (self.touched_early or self.unflown())
        return known and whole and self._airborne and (self.landed or not self._lands)

    @property
    def take_off_missed(self) -> str:
        """Distance by which a plan without waypoints was flown below its take-off, in words; empty: it came up."""
        return self._take_off.missed

    @property
    def touched_early(self) -> str | None:
        """Contact with the ground before the last waypoint, in words; None without one."""
        if self._grounded is None:
            return None
        t_s, waypoint = self._grounded
        return f"touched the ground at {t_s:.1f} s, on the way to waypoint {waypoint}"

    def values(self) -> dict[str, float | None]:
        """Return every measurement by name; None: the flight did not yield it."""
        found: dict[str, float | None] = {name: self._values.get(name) for name in PlaneLimits.model_fields}
        end = self._last_leg.end_W if self._last_leg is not None else None
        touch = self._touch if self._touched else None
        if touch is None:
            found["touchdown_sink_mps"] = None
        else:
            found["touchdown_bank_deg"] = abs(math.degrees(bank_rad(touch)))
        if touch is not None and end is not None and self._approaches:
            before, (x, y) = self._stops[-2].place, self._stops[-1].place
            length = max(math.dist(before, (x, y)), 1e-9)
            t = ((x - before[0]) / length, (y - before[1]) / length)
            dx, dy = touch.p_WB[0] - x, touch.p_WB[1] - y
            found["touchdown_offset_m"] = abs(t[0] * dy - t[1] * dx)
            found["touchdown_error_m"] = abs(t[0] * dx + t[1] * dy)
        if touch is not None and end is not None and self._returns:
            found["touchdown_error_m"] = math.dist(touch.p_WB[:2], end[:2])
        if self._rolls is not None:
            found |= self._rolls.values()
        last = touch or self._previous
        if last is not None and end is not None and self._airborne and (self.landed or not self._lands):
            found["final_error_m"] = math.dist(last.p_WB[:2], end[:2])
        return found

    def called_for(self) -> frozenset[str]:
        """Return the names of the measurements that this plan must yield."""
        names = {"airspeed_margin", "max_bank_deg", "stalled_s"} if self._last_leg is not None else set()
        if self._lands:
            names |= {"touchdown_sink_mps", "touchdown_bank_deg", "touchdown_error_m", "final_error_m"}
            if self._approaches:
                names.add("touchdown_offset_m")
        if any(stop.turns >= 0.5 for stop in self._stops):
            names.add("loiter_error_m")
        if len(self._targets) > 1:
            names.add("max_cross_track_m")
        if self._rolls is not None and self._last_leg is not None:
            names |= self._rolls.called_for()
        return frozenset(names)


def bank_rad(truth: TruthState) -> float:
    """Return the bank: the angle of the body's y axis under the horizontal, right wing down positive."""
    R = matrix_of(truth.q_WB)
    return math.atan2(R[7], R[8])


def stall_at(stall_mps: float, bank_rad: float) -> float:
    """Return the stall speed at the load of a level turn, of 84 degrees of bank at most."""
    return stall_mps / math.sqrt(max(math.cos(bank_rad), 0.1))


def _seconds(before: TruthState | None, now: TruthState) -> float:
    """Return the time since the last tick that was measured, 0 after a gap."""
    if before is None or now.tick - before.tick != _STRIDE:
        return 0.0
    return (now.t_ns - before.t_ns) / NS_PER_S


def judge_plane(measured: PlaneMeasurement, limits: PlaneLimits, *, outcome: Outcome = "complete") -> Verdict:
    """Return the verdict on how a plane flew its plan under these limits; `outcome` as in `verdict.judge`."""
    return judge_by(measured, dict(limits), outcome=outcome)


def judge_by(measured: PlaneMeasurement, limits: Mapping[str, float | None], *, outcome: Outcome) -> Verdict:
    """Return the verdict under limits by the name of the measurement."""
    called_for = measured.called_for() if outcome == "complete" else frozenset[str]()
    reasons: list[str] = []
    reached, waypoints = measured.counts
    if called_for and not measured.completed:
        if measured.endless_item is not None:
            reasons.append(f"the mission never ends: item {measured.endless_item + 1} jumps back for ever")
        elif reached < waypoints:
            reasons.append(f"reached {reached} of {waypoints} waypoints")
        elif measured.take_off_missed:
            reasons.append(measured.take_off_missed)
        elif not (measured.unflown() or measured.touched_early):
            reasons.append("the mission was not finished: the vehicle did not end on the ground")
        reasons += [text for text in (measured.unflown(), measured.touched_early) if text]
    if outcome == "aborted" and measured.completed:
        reasons.append("the mission was completed, but the script expects that it is not (outcome: aborted)")
    rows: list[Row] = []
    for name, value in measured.values().items():
        limit = None if outcome == "crashed" else limits.get(name)
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
