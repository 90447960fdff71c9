"""Execution of missions.

Waypoints that are flown through are joined to one trajectory (a run) with rounded corners; a run ends at the first
item that needs a stop: a hold time, a delay, a loiter, a landing, a jump, or the end. Items without a position
(speed, camera) take effect when the waypoint before them is passed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.flight_modes import Landing, TakeoffClimb
from firmware_bridge.mock_pixhawk.flight.guidance import Guidance
from firmware_bridge.mock_pixhawk.flight.mission_item import (
    NAVIGATION,
    PAYLOAD,
    RELATIVE_FRAMES,
    has_no_position,
    value_or,
)
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.ids import Cmd, MissionState
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.mission import MissionItem
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG, TURN_RAD

_CORNER_RADIUS_M = 0.5  # a waypoint counts as reached no further away than this plus its acceptance radius
_ITEMS_PER_STEP = 50  # items without duration done in one step; ends missions that only jump


class PathItem(NamedTuple):
    """Mission item on a path, complete at path length `s`. `yaw`: heading on the way to it (None: along the path)."""

    seq: int
    s: float
    point: Point
    radius_m: float
    yaw: float | None


class Navigator:
    """AUTO.MISSION. `reached(seq)` reports progress; `project(lat, lon, alt)` returns local NED."""

    def __init__(
        self,
        guidance: Guidance,
        vehicle: Vehicle,
        params: ParamTable,
        *,
        project: Callable[[float, float, float], Point],
        reached: Callable[[int], None],
        info: Callable[[str], None],
        set_home: Callable[[Point | None], None],
    ) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._project, self._reached, self._info, self._set_home = project, reached, info, set_home
        self._climb = TakeoffClimb(guidance, vehicle, params)
        self._landing = Landing(guidance, vehicle, params)
        self.items: list[MissionItem] = []
        self.index = 0  # current item; len(items) when there is none left
        self.complete = False
        self._active = False
        self._path_items: list[PathItem] = []
        self._action: Callable[[int], bool] | None = None  # returns True when the current item is done
        self._speed: float | None = None
        self._jumps: dict[int, int] = {}
        self._next_mode: Mode | None = None

    # -- mission and progress -----------------------------------------------------------------------------------

    def load(self, items: list[MissionItem]) -> None:
        """Take a new mission; an empty one clears it."""
        self.items = items
        self._restart()
        if self._active:
            self._guidance.brake()
            if not items:
                self._next_mode = Mode.LOITER

    def _restart(self) -> None:
        self.index = 0
        self.complete = False
        self._jumps = {}
        self._speed = None
        self._path_items, self._action = [], None

    def set_current(self, seq: int) -> bool:
        """Continue with item `seq`. Return False if there is none."""
        if not 0 <= seq < len(self.items):
            return False
        self.index = seq
        self.complete = False
        self._path_items, self._action = [], None
        if self._active:
            self._guidance.brake()
        return True

    def state(self) -> int:
        """Return MISSION_CURRENT.mission_state."""
        if not self.items:
            return MissionState.NO_MISSION
        if self.complete:
            return MissionState.COMPLETE
        if self._active:
            return MissionState.ACTIVE
        return MissionState.NOT_STARTED if self.index == 0 else MissionState.PAUSED

    def current_seq(self) -> int:
        """Return MISSION_CURRENT.seq."""
        return max(min(self.index, len(self.items) - 1), 0)

    def infeasible(self) -> str | None:
        """Return why the mission cannot be flown from home, or None."""
        if not self.items:
            return "no valid mission"
        home, limit = self._vehicle.home, self._params["MIS_DIST_1WP"]
        first = next((i for i in self.items if i.command in NAVIGATION and not has_no_position(i)), None)
        if first is None or home is None or limit <= 0.0:
            return None
        n, e, _ = self._point(first, (home.n_m, home.e_m, home.d_m))
        distance = sqrt((n - home.n_m) * (n - home.n_m) + (e - home.e_m) * (e - home.e_m))
        if distance > limit:
            return f"first waypoint is {distance / 1e3:.1f} km away, MIS_DIST_1WP is {limit / 1e3:g} km"
        return None

    # -- as a flight mode ---------------------------------------------------------------------------------------

    def start(self, now_us: int) -> None:  # noqa: ARG002
        if self.complete:
            self._restart()
        self._active = True
        self._path_items, self._action = [], None
        self._next_mode = None
        self._guidance.brake()

    def stop(self) -> None:
        """Stop after the mode was left or the vehicle disarmed."""
        self._active = False

    def step(self, now_us: int) -> Mode | None:
        if self._next_mode is not None:
            mode, self._next_mode = self._next_mode, None
            return mode
        for _ in range(_ITEMS_PER_STEP):
            if self._action is None:
                if self.index >= len(self.items):
                    return self._finish()
                self._action = self._begin(self.items[self.index], now_us)
            if not self._action(now_us):
                return None
            self._action = None
            if self._next_mode is not None:
                mode, self._next_mode = self._next_mode, None
                return mode
        self._info("Mission rejected: it only jumps")
        self._finish()
        return Mode.LOITER

    def _finish(self) -> Mode | None:
        if not self.complete:
            self.complete = True
            self._info("Mission finished, landed" if self._vehicle.landed else "Mission finished, loitering")
        if self._vehicle.landed:
            self._guidance.idle()
            return None
        return Mode.LOITER

    def _done(self, seq: int) -> None:
        """Report item `seq` as reached and go on to the next."""
        self._reached(seq)
        self.index = seq + 1

    # -- items --------------------------------------------------------------------------------------------------

    def _point(self, item: MissionItem, otherwise: Point) -> Point:
        """Return local NED of a navigation item, with north and east of `otherwise` if the item has no position."""
        home = self._vehicle.home
        relative = item.frame in RELATIVE_FRAMES and home is not None
        alt = home.alt_m + item.alt_m if relative and home is not None else item.alt_m
        if has_no_position(item):
            _, _, d = self._project(0.0, 0.0, alt)
            return (otherwise[0], otherwise[1], d)
        return self._project(item.lat_degE7 / 1e7, item.lon_degE7 / 1e7, alt)

    def _begin(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        """Start `items[index]`. Return a function to call every step until it returns True."""
        command = item.command
        if command in NAVIGATION and command != Cmd.NAV_LAND and self._vehicle.landed:
            return self._begin_climb(item)
        if command in NAVIGATION:
            return self._begin_run()
        if command in (Cmd.NAV_DELAY, Cmd.CONDITION_DELAY):
            return self._wait(item.seq, now_us, value_or(item.param1, 0.0))
        if command == Cmd.CONDITION_YAW:
            return self._begin_yaw(item)
        if command == Cmd.NAV_RETURN_TO_LAUNCH:
            self._next_mode = Mode.RTL
            self.complete = True
            self._done(item.seq)
            return lambda _now: True
        return lambda _now: self._instant(item)

    def _instant(self, item: MissionItem) -> bool:
        """Carry out an item that takes no time."""
        command = item.command
        if command == Cmd.DO_JUMP:
            done = self._jumps.get(item.seq, 0)
            if item.param2 < 0.0 or done < int(value_or(item.param2, 0.0)):
                self._jumps[item.seq] = done + 1
                self._reached(item.seq)
                self.index = int(item.param1)
                return True
        elif command == Cmd.DO_CHANGE_SPEED:
            self.change_speed(item.param2)
        elif command == Cmd.DO_SET_HOME:
            use_current = item.param1 == 1.0 or has_no_position(item)
            self._set_home(
                None if use_current else (item.lat_degE7 / 1e7, item.lon_degE7 / 1e7, value_or(item.alt_m, 0.0))
            )
        elif command not in PAYLOAD:
            self._info(f"Mission item {item.seq} ignored")
        self._done(item.seq)
        return True

    def change_speed(self, speed_mps: float) -> bool:
        """Set the horizontal speed of the next legs (-1: no change, -2: default). Return False if it is neither."""
        self._speed, known = self._speed_after(self._speed, speed_mps)
        return known

    @staticmethod
    def _speed_after(now: float | None, asked_mps: float) -> tuple[float | None, bool]:
        """Return the speed after DO_CHANGE_SPEED to `asked_mps` (None: default), and True if `asked_mps` is valid."""
        if asked_mps > 0.0:
            return asked_mps, True
        return (None, True) if asked_mps == -2.0 else (now, asked_mps == -1.0)

    def _wait(self, seq: int, now_us: int, seconds: float) -> Callable[[int], bool]:
        until = now_us + int(min(seconds, 1e6) * US_PER_S)

        def step(now: int) -> bool:
            if self._vehicle.landed:
                self._guidance.idle()
            else:
                self._guidance.follow()
            if now >= until:
                self._done(seq)
                return True
            return False

        return step

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
