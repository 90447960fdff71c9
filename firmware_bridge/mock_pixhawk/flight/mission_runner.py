"""Execution of missions: progress, jumps, and the items that take no time. What flies adds the flown ones.

`Navigator` does it for a multirotor, `plane/plane_navigator.py` for a plane.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
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
from signals.mission import MissionItem
from signals.time import US_PER_S

_ITEMS_PER_STEP = 50  # items without duration done in one step; ends missions that only jump


class MissionRunner:
    """AUTO.MISSION."""

    navigation = NAVIGATION  # commands that are flown

    def __init__(self, parts: FirmwareParts) -> None:
        self._vehicle, self._params, self._project = parts.vehicle, parts.params, parts.estimate.ned
        callbacks = parts.callbacks
        self._reached, self._info, self._set_home = callbacks.on_reached, callbacks.info, callbacks.set_mission_home
        self.items: list[MissionItem] = []
        self.index = 0  # current item; len(items) when there is none left
        self.complete = False
        self._active = False
        self._action: Callable[[int], bool] | None = None  # returns True when the current item is done
        self._speed: float | None = None
        self._jumps: dict[int, int] = {}
        self._next_mode: Mode | None = None

    # -- what flies ---------------------------------------------------------------------------------------------

    def _begin(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        """Start an item. Return a function to call every step until it returns True.

        This one starts delays, returns and items without a way, which are the same whatever flies.
        """
        if item.command in (Cmd.NAV_DELAY, Cmd.CONDITION_DELAY):
            return self._wait(item.seq, now_us, value_or(item.param1, 0.0))
        if item.command == Cmd.NAV_RETURN_TO_LAUNCH:
            self._next_mode = Mode.RTL
            self.complete = True
            return lambda _now: self._pass(item)
        return lambda _now: self._instant(item)

    def _go_on(self) -> None:
        """Stay, or fly on, while the current item is a wait in the air."""
        raise NotImplementedError

    def _stay(self) -> None:
        """Stop, or circle, where the vehicle is: the next item is not yet begun."""
        raise NotImplementedError

    def _idle(self) -> None:
        """Run idle on the ground."""
        raise NotImplementedError

    def _forget(self) -> None:
        """Forget the item that is being flown."""
        self._action = None

    # -- mission and progress -----------------------------------------------------------------------------------

    def load(self, items: list[MissionItem]) -> None:
        """Take a new mission; an empty one clears it."""
        self.items = items
        self._restart()
        if self._active:
            self._stay()
            if not items:
                self._next_mode = Mode.LOITER

    def _restart(self) -> None:
        self.index = 0
        self.complete = False
        self._jumps = {}
        self._speed = None
        self._forget()

    def set_current(self, seq: int) -> bool:
        """Continue with item `seq`. Return False if there is none."""
        if not 0 <= seq < len(self.items):
            return False
        self.index = seq
        self.complete = False
        self._forget()
        if self._active:
            self._stay()
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
        first = next((i for i in self.items if i.command in self.navigation and not has_no_position(i)), None)
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
        self._forget()
        self._next_mode = None
        self._stay()

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
            self._idle()
            return None
        return Mode.LOITER

    def _done(self, seq: int) -> None:
        """Report item `seq` as reached and go on to the next."""
        self._reached(seq)
        self.index = seq + 1

    # -- items --------------------------------------------------------------------------------------------------

    def _pass(self, item: MissionItem) -> bool:
        self._done(item.seq)
        return True

    def _wait(self, seq: int, now_us: int, seconds: float) -> Callable[[int], bool]:
        until = now_us + int(min(seconds, 1e6) * US_PER_S)

        def step(now: int) -> bool:
            if self._vehicle.landed:
                self._idle()
            else:
                self._go_on()
            if now < until:
                return False
            self._done(seq)
            return True

        return step

    def _following(self, item: MissionItem) -> MissionItem | None:
        """Return the next item that is flown; None if there is none, or it has no place."""
        following = next((i for i in self.items[item.seq + 1 :] if i.command in self.navigation), None)
        return None if following is None or has_no_position(following) else following

    def _point(self, item: MissionItem, otherwise: Point) -> Point:
        """Return local NED of a navigation item, with north and east of `otherwise` if the item has no position."""
        home = self._vehicle.home
        relative = item.frame in RELATIVE_FRAMES and home is not None
        alt = home.alt_m + item.alt_m if relative and home is not None else item.alt_m
        if has_no_position(item):
            _, _, d = self._project(0.0, 0.0, alt)
            return (otherwise[0], otherwise[1], d)
        return self._project(item.lat_degE7 / 1e7, item.lon_degE7 / 1e7, alt)

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
