"""Execution of missions by a multirotor.

Waypoints that are flown through are joined to one trajectory (a run) with rounded corners; a run ends at the first
item that needs a stop: a hold time, a delay, a loiter, a landing, a jump, or the end. Items without a position
(speed, camera) take effect when the waypoint before them is passed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.flight_modes import Landing, TakeoffClimb
from firmware_bridge.mock_pixhawk.flight.guidance import Guidance
from firmware_bridge.mock_pixhawk.flight.mission_item import (
    NAVIGATION,
    PAYLOAD,
    value_or,
)
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.ids import Cmd
from signals.mission import MissionItem
from signals.units import RAD_PER_DEG, TURN_RAD

_CORNER_RADIUS_M = 0.5  # a waypoint counts as reached no further away than this plus its acceptance radius


class PathItem(NamedTuple):
    """Mission item on a path, complete at path length `s`. `yaw`: heading on the way to it (None: along the path)."""

    seq: int
    s: float
    point: Point
    radius_m: float
    yaw: float | None


class Navigator(MissionRunner):
    """AUTO.MISSION of a multirotor."""

    def __init__(self, guidance: Guidance, parts: FirmwareParts) -> None:
        super().__init__(parts)
        self._guidance = guidance
        self._climb = TakeoffClimb(guidance, parts.vehicle, parts.params)
        self._landing = Landing(guidance, parts.vehicle, parts.params)
        self._path_items: list[PathItem] = []

    def _stay(self) -> None:
        self._guidance.brake()

    def _idle(self) -> None:
        self._guidance.idle()

    def _go_on(self) -> None:
        self._guidance.follow()

    def _forget(self) -> None:
        self._path_items, self._action = [], None

    # -- items --------------------------------------------------------------------------------------------------

    def _begin(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        command = item.command
        if command in NAVIGATION and command != Cmd.NAV_LAND and self._vehicle.landed:
            return self._begin_climb(item)
        if command in NAVIGATION:
            return self._begin_run()
        if command == Cmd.CONDITION_YAW:
            return self._begin_yaw(item)
        return super()._begin(item, now_us)

    def _begin_yaw(self, item: MissionItem) -> Callable[[int], bool]:
        guidance = self._guidance
        angle = value_or(item.param1, 0.0) * RAD_PER_DEG
        if item.param4 == 1.0:
            angle = guidance.yaw + (-angle if item.param3 < 0.0 else angle)
        guidance.yaw_target = el.wrap_pi(angle - TURN_RAD * int(angle / TURN_RAD))

        def step(now: int) -> bool:  # noqa: ARG001
            guidance.follow()
            if abs(el.wrap_pi(self._vehicle.yaw - (guidance.yaw_target or 0.0))) < 0.1:
                self._done(item.seq)
                return True
            return False

        return step

    def _begin_climb(self, item: MissionItem) -> Callable[[int], bool]:
        """Take off to the altitude of a take-off item, else to MIS_TAKEOFF_ALT above home."""
        vehicle = self._vehicle
        if item.command == Cmd.NAV_TAKEOFF:
            target_d = self._point(item, self._guidance.here())[2]
        else:
            ground_d = vehicle.home.d_m if vehicle.home is not None else vehicle.pos_d
            target_d = ground_d - self._params["MIS_TAKEOFF_ALT"]
        self._climb.start(target_d)
        if vehicle.home is not None:
            self._info(f"Takeoff to {vehicle.home.d_m - target_d:.1f} meters above home")
        # After the climb the item is flown as an ordinary waypoint.
        return self._climb.step

    def _begin_run(self) -> Callable[[int], bool]:
        """Start a trajectory through the items from `index` on that need no stop."""
        guidance, items = self._guidance, self.items
        points = [guidance.setpoint_position()]
        speeds: list[float] = []
        found: list[tuple[MissionItem, int]] = []  # item, index into points
        speed = self._speed
        for item in items[self.index :]:
            if item.command in NAVIGATION:
                point = self._point(item, points[-1])
                if item.command == Cmd.NAV_LAND:
                    point = (point[0], point[1], points[-1][2])
                if found or self._far(point, points[0]):
                    speeds.append(speed if speed is not None else guidance.cruise_mps)
                    points.append(point)
                found.append((item, len(points) - 1))
                if self._stops(item):
                    break
            elif item.command == Cmd.DO_CHANGE_SPEED:
                speed, _ = self._speed_after(speed, item.param2)
                found.append((item, len(points) - 1))
            elif item.command in PAYLOAD:
                found.append((item, len(points) - 1))
            else:
                break
        # Items after the last navigation item are carried out after the run.
        while found and found[-1][0].command not in NAVIGATION:
            found.pop()
        guidance.yaw_target = None
        guidance.course_yaw = True
        if len(points) > 1:
            s = guidance.fly(points, speeds).waypoint_s
        else:
            guidance.hold(points[0])
            s = [0.0]
        self._path_items = [
            PathItem(item.seq, s[k], points[k], self._acceptance(item), self._yaw_of(item)) for item, k in found
        ]
        if self._path_items:
            guidance.yaw_target = self._path_items[0].yaw
        last = found[-1][0]
        after: Callable[[int], bool] | None = None

        def step(now: int) -> bool:
            nonlocal after
            if after is not None:
                return after(now)
            guidance.follow()
            if self._pass_items(last.seq):
                after = self._begin_stop(last, points[-1], now)
            return False

        return step

    @staticmethod
    def _far(point: Point, other: Point) -> bool:
        """Return True if the points are far enough apart for a leg."""
        dn, de, dd = point[0] - other[0], point[1] - other[1], point[2] - other[2]
        return dn * dn + de * de + dd * dd > 0.01

    @staticmethod
    def _stops(item: MissionItem) -> bool:
        through = item.command in (Cmd.NAV_WAYPOINT, Cmd.NAV_TAKEOFF)
        held = item.command == Cmd.NAV_WAYPOINT and value_or(item.param1, 0.0) > 0.0
        return not through or held or not item.autocontinue

    def _acceptance(self, item: MissionItem) -> float:
        radius = value_or(item.param2, 0.0) if item.command == Cmd.NAV_WAYPOINT else 0.0
        return radius if radius > 0.0 else self._params["NAV_ACC_RAD"]

    @staticmethod
    def _yaw_of(item: MissionItem) -> float | None:
        """Return the heading [rad] that an item demands, or None for the direction of travel."""
        if item.command not in NAVIGATION or item.param4 != item.param4:
            return None
        return el.wrap_pi((item.param4 - 360.0 * int(item.param4 / 360.0)) * RAD_PER_DEG)

    def _pass_items(self, last_seq: int) -> bool:
        """Complete the items that trajectory and vehicle have passed. Return True once the last one is reached."""
        guidance = self._guidance
        trajectory = guidance.trajectory
        s = trajectory.s if trajectory is not None else 0.0
        while self._path_items:
            item = self._path_items[0]
            if s < item.s:
                return False
            final = item.seq == last_seq
            if final and trajectory is not None and not trajectory.done:
                return False
            horizontal, vertical = guidance.distance_to(item.point)
            if horizontal > item.radius_m + _CORNER_RADIUS_M or vertical > self._params["NAV_MC_ALT_RAD"]:
                return False
            if final:
                return True
            if self.items[item.seq].command == Cmd.DO_CHANGE_SPEED:
                self.change_speed(self.items[item.seq].param2)
            self._done(item.seq)
            self._path_items.pop(0)
            guidance.yaw_target = self._path_items[0].yaw
        return True

    def _begin_stop(self, item: MissionItem, point: Point, now_us: int) -> Callable[[int], bool]:
        """Start the action at the end of a run. Return a function to call every step until it returns True."""
        command = item.command
        if command == Cmd.NAV_LAND:
            self._landing.start(point)

            def land(now: int) -> bool:  # noqa: ARG001
                if self._landing.step():
                    self._done(item.seq)
                    return True
                return False

            return land
        if command == Cmd.NAV_LOITER_UNLIM or not item.autocontinue:

            def stay(now: int) -> bool:  # noqa: ARG001
                self._guidance.follow()
                return False

            return stay
        seconds = value_or(item.param1, 0.0) if command in (Cmd.NAV_WAYPOINT, Cmd.NAV_LOITER_TIME) else 0.0
        return self._wait(item.seq, now_us, seconds)
