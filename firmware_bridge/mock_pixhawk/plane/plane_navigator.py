"""Execution of missions by a plane: it flies through waypoints and circles instead of stopping.

    waypoint   the straight line from the place before; height along it in proportion (first-order hold), as PX4's
               reached at the distance in which the waypoint is passed. Passed within
               the greater of NAV_ACC_RAD, its own radius and NPFG's switch distance, or once it is behind the plane
    loiter     a circle: param 3 is its radius (negative: counter-clockwise), else NAV_LOITER_RAD. TIME and TURNS count
               from the moment on the circle; TO_ALT ends at its height. Left towards the next item once the course
               points there, within 10 degrees, or at the latest after another turn
    landing    an approach from the place before (`landing.py`)

A mission that ends in the air goes on as Hold about its last place.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.mission_item import PLANE_NAVIGATION, has_no_position, value_or
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.ids import Cmd
from firmware_bridge.mock_pixhawk.plane.landing import PlaneLanding
from firmware_bridge.mock_pixhawk.plane.path import Circle, Line, line_between
from firmware_bridge.mock_pixhawk.plane.pilot import PERIOD_S, PlanePilot
from firmware_bridge.mock_pixhawk.plane.takeoff import PlaneTakeoff
from signals.mission import MissionItem
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG, TURN_RAD

_ON_CIRCLE = 0.25  # share of the radius within which a plane counts as on its circle
_EXIT_RAD = 10.0 * RAD_PER_DEG
_LEAST_RADIUS_M = 10.0
_LOITERS = frozenset({Cmd.NAV_LOITER_UNLIM, Cmd.NAV_LOITER_TIME, Cmd.NAV_LOITER_TURNS, Cmd.NAV_LOITER_TO_ALT})


class PlaneNavigator(MissionRunner):
    """AUTO.MISSION of a plane."""

    navigation = PLANE_NAVIGATION

    def __init__(self, pilot: PlanePilot, parts: FirmwareParts, takeoff: PlaneTakeoff, landing: PlaneLanding) -> None:
        super().__init__(parts)
        self._pilot, self._takeoff, self._landing = pilot, takeoff, landing
        self._from: Point | None = None  # the place before the current item
        self._d = 0.0  # height of flight while no item gives one

    # -- what flies ---------------------------------------------------------------------------------------------

    def _stay(self) -> None:
        self._from = None
        self._d = self._vehicle.pos_d
        if not self._vehicle.landed:
            self._pilot.circle_here()

    def _idle(self) -> None:
        self._pilot.idle()

    def _go_on(self) -> None:
        self._pilot.fly(d_m=self._d)

    def infeasible(self) -> str | None:
        why = super().infeasible()
        if why is not None or not self._vehicle.landed:
            return why
        current = self.items[min(self.index, len(self.items) - 1) if not self.complete else 0 :]
        first = next((item for item in current if item.command in self.navigation), None)
        if first is not None and first.command != Cmd.NAV_TAKEOFF:
            return "a plane on the ground needs a take-off item first"
        return None

    def change_speed(self, speed_mps: float) -> bool:
        known = super().change_speed(speed_mps)
        self._pilot.airspeed_mps = self._speed
        return known

    def go_to_landing(self) -> bool:
        """Make DO_LAND_START, else the item before the landing, the current one. Return False without a landing."""
        landing = next((item.seq for item in self.items if item.command == Cmd.NAV_LAND), None)
        if landing is None:
            return False
        start = next((item.seq for item in self.items if item.command == Cmd.DO_LAND_START), None)
        if start is None:
            before = [item.seq for item in self.items[:landing] if item.command in self.navigation]
            start = before[-1] if before and self.items[before[-1]].command != Cmd.NAV_TAKEOFF else landing
        return self.set_current(start)

    def _begin(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        command = item.command
        self._landing.flaring = False
        self._pilot.airspeed_mps = self._speed
        if command == Cmd.NAV_TAKEOFF:
            return self._begin_takeoff(item, now_us)
        if command == Cmd.NAV_WAYPOINT:
            return self._begin_waypoint(item, now_us)
        if command in _LOITERS:
            return self._begin_loiter(item)
        if command == Cmd.NAV_LAND:
            return self._begin_landing(item)
        if command == Cmd.DO_LAND_START:  # a mark, for `go_to_landing`
            return lambda _now: self._pass(item)
        return super()._begin(item, now_us)  # CONDITION_YAW is ignored: a plane flies where its nose points

    # -- items --------------------------------------------------------------------------------------------------

    def _begin_takeoff(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        target = self._point(item, self._pilot.here())
        to = None if has_no_position(item) else (target[0], target[1])
        if self._vehicle.landed:
            self._takeoff.begin(now_us, target[2], to)
            if self._vehicle.home is not None:
                self._info(f"Takeoff to {self._vehicle.home.d_m - target[2]:.1f} meters above home")
        elif to is not None:
            return self._begin_waypoint(item, now_us)
        else:
            self._takeoff.begin(now_us, target[2], None)

        def step(now: int) -> bool:
            if not self._takeoff.climb(now):
                return False
            self._from = None
            self._done(item.seq)
            return True

        return step

    def _line_to(self, point: Point) -> tuple[Line, Point, float]:
        """Return the line from the place before to `point`, its start and its length."""
        start = self._pilot.here() if self._from is None else self._from
        line = line_between(start[0], start[1], point[0], point[1], otherwise_rad=self._pilot.course_rad)
        dn, de = point[0] - start[0], point[1] - start[1]
        return line, start, sqrt(dn * dn + de * de)

    def _begin_waypoint(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        pilot, p = self._pilot, self._params
        point = self._point(item, pilot.here())
        line, start, length = self._line_to(point)
        own = value_or(item.param2, 0.0) if item.command == Cmd.NAV_WAYPOINT else 0.0
        hold_s = value_or(item.param1, 0.0) if item.command == Cmd.NAV_WAYPOINT else 0.0
        del now_us
        after: Callable[[int], bool] | None = None

        def step(now: int) -> bool:
            nonlocal after
            if after is not None:
                return after(now)
            n, e, d = pilot.here()
            along = line.along_m(n, e)
            near = max(own, p["NAV_ACC_RAD"], min(pilot.turn_distance_m(), 0.4 * length))
            # At its height where the next leg begins: with the wind from behind that is early.
            share = min(max(along / (length - near), 0.0), 1.0) if length - near > 1.0 else 1.0
            pilot.path = line
            pilot.fly(d_m=start[2] + (point[2] - start[2]) * share)
            self._d = point[2]
            dn, de = n - point[0], e - point[1]
            at_place = dn * dn + de * de <= near * near or along >= length
            if not at_place:
                return False
            if abs(d - point[2]) > p["NAV_FW_ALT_RAD"] and length > 1.0:
                # Too high or too low: circle about the waypoint to its height, as PX4 does.
                after = self._circle(item, point, lambda _now: abs(pilot.here()[2] - point[2]) < p["NAV_FW_ALT_RAD"])
                return False
            if hold_s > 0.0 or not item.autocontinue:
                after = self._circle(item, point, _after_s(hold_s if item.autocontinue else 1e9))
                return False
            self._from = point
            self._done(item.seq)
            return True

        return step

    def _begin_loiter(self, item: MissionItem) -> Callable[[int], bool]:
        command, pilot = item.command, self._pilot
        point = self._point(item, pilot.here())
        if command == Cmd.NAV_LOITER_TIME:
            return self._circle(item, point, _after_s(value_or(item.param1, 0.0)))
        if command == Cmd.NAV_LOITER_TURNS:
            return self._circle(item, point, self._after_turns(point, value_or(item.param1, 1.0)))
        if command == Cmd.NAV_LOITER_TO_ALT:
            limit = self._params["NAV_FW_ALTL_RAD"]
            return self._circle(item, point, lambda _now: abs(pilot.here()[2] - point[2]) < limit)
        return self._circle(item, point, lambda _now: False)

    def _radius_of(self, item: MissionItem) -> float:
        """Return the signed radius of a loiter item. LOITER_TO_ALT has it in param 2, a waypoint none."""
        radius = 0.0
        if item.command == Cmd.NAV_LOITER_TO_ALT:
            radius = value_or(item.param2, 0.0)
        elif item.command in _LOITERS:
            radius = value_or(item.param3, 0.0)
        radius = radius if radius != 0.0 else self._params["NAV_LOITER_RAD"]
        return radius if abs(radius) >= _LEAST_RADIUS_M else _LEAST_RADIUS_M

    def _circle(self, item: MissionItem, point: Point, done: Callable[[int], bool]) -> Callable[[int], bool]:
        """Circle about `point` until `done`, which is asked from the moment on the circle, and the course fits."""
        pilot = self._pilot
        radius = self._radius_of(item)
        circle = Circle(point[0], point[1], abs(radius), radius > 0.0)
        finished_turn = 0.0

        def step(now: int) -> bool:
            nonlocal finished_turn
            pilot.path = circle
            pilot.fly(d_m=point[2])
            self._d = point[2]
            n, e, _ = pilot.here()
            dn, de = n - circle.n, e - circle.e
            off = abs(sqrt(dn * dn + de * de) - circle.radius_m)
            if finished_turn == 0.0 and (off > _ON_CIRCLE * circle.radius_m or not done(now)):
                return False
            finished_turn += pilot.ground_speed_mps * PERIOD_S / circle.radius_m
            if finished_turn < TURN_RAD and not self._points_ahead(item):
                return False
            self._from = None
            self._done(item.seq)
            return True

        return step

    def _points_ahead(self, item: MissionItem) -> bool:
        """Return True if the course leads to the next item with a place, or there is none."""
        following = self._following(item)
        if following is None:
            return True
        n, e, d = self._pilot.here()
        to = self._point(following, (n, e, d))
        if following.command == Cmd.NAV_LAND:
            self._from = None
        bearing = el.atan2(to[1] - e, to[0] - n)
        return abs(el.wrap_pi(bearing - self._pilot.course_rad)) < _EXIT_RAD

    def _after_turns(self, point: Point, turns: float) -> Callable[[int], bool]:
        """Return a function that becomes True after so many turns about a point."""
        before: float | None = None
        turned = 0.0

        def done(now: int) -> bool:  # noqa: ARG001
            nonlocal before, turned
            n, e, _ = self._pilot.here()
            bearing = el.atan2(e - point[1], n - point[0])
            if before is not None:
                turned += el.wrap_pi(bearing - before)
            before = bearing
            return abs(turned) >= 2.0 * pi * max(turns, 0.0)

        return done

    def _begin_landing(self, item: MissionItem) -> Callable[[int], bool]:
        pilot, vehicle = self._pilot, self._vehicle
        point = self._point(item, pilot.here())
        entry = pilot.here() if self._from is None else self._from
        if has_no_position(item):
            course = pilot.course_rad
            angle = self._params["FW_LND_ANG"] * RAD_PER_DEG
            length = max((point[2] - entry[2]) * el.cos(angle) / el.sin(angle), 1.0)
            point = (entry[0] + length * el.cos(course), entry[1] + length * el.sin(course), point[2])
        self._landing.start(entry, point)
        self._info("Landing")

        def step(now: int) -> bool:
            if not self._landing.step(now):
                return False
            self._done(item.seq)
            return vehicle.landed

        return step


def _after_s(seconds: float) -> Callable[[int], bool]:
    """Return a function of the time that becomes True so long after its first call."""
    until_us: int | None = None

    def done(now_us: int) -> bool:
        nonlocal until_us
        if until_us is None:
            until_us = now_us + int(min(seconds, 1e6) * US_PER_S)
        return now_us >= until_us

    return done
