"""Progress of a mission: items reached, in the air or on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from signals.mission import MissionItem

_LANDED_ON_GROUND = 1
_LANDED_IN_AIR = (2, 3, 4)  # in the air, taking off, landing
_MISSION_STATE_COMPLETE = 5

_RETURN_TO_LAUNCH = 20
_LAND = 21
_VTOL_LAND = 85
_DO_JUMP = 177
# Items that end the flight by themselves.
_ENDINGS = (_RETURN_TO_LAUNCH, _LAND, _VTOL_LAND)
# Navigation items that lead to a place: waypoint, three loiters, take-off, loiter to altitude, spline, VTOL
# take-off.
_TO_A_PLACE = (16, 17, 18, 19, 22, 31, 82, 84)


def is_waypoint(item: MissionItem) -> bool:
    """Return True if the item has a place to fly to. A landing counts if it has one; a return does not."""
    if item.command in (_LAND, _VTOL_LAND):
        return item.lat_degE7 != 0 or item.lon_degE7 != 0
    return item.command in _TO_A_PLACE


def navigation_items(items: Sequence[MissionItem]) -> list[MissionItem]:
    """Return the items that the vehicle flies: waypoints and endings, without the DO_ and CONDITION_ ones."""
    return [item for item in items if is_waypoint(item) or item.command in _ENDINGS]


class Progress:
    """Counts of one flight of `items`. An item is identified by its index."""

    def __init__(self, items: Sequence[MissionItem]) -> None:
        self._items_known = bool(items)
        self._waypoints = [index for index, item in enumerate(items) if is_waypoint(item)]
        flight_items = navigation_items(items)
        self.lands_by_itself = bool(flight_items) and flight_items[-1].command in _ENDINGS
        landings = [index for index in self._waypoints if items[index].command in (_LAND, _VTOL_LAND)]
        self._final_landing = landings[-1] if landings and landings[-1] == self._waypoints[-1] else None
        # With jumps an item is reached more than once, so only the vehicle knows when the mission is complete.
        self._jumps = any(item.command == _DO_JUMP for item in items)
        self._reached: dict[int, None] = {}
        self._reported_complete = False
        self.first_seq = 0  # the vehicle's number of item 0
        self.current = 0
        self.landed_state = 0
        self.flown = False

    @property
    def waypoints(self) -> int:
        return len(self._waypoints)

    @property
    def reached(self) -> int:
        """Number of waypoints that the vehicle reported as reached; of an unknown mission, of all items."""
        if not self._items_known:
            return len(self._reached)
        return sum(index in self._reached for index in self._waypoints)

    @property
    def completed(self) -> bool:
        """True if every waypoint is reached (in a mission without jumps), or the vehicle reports completion."""
        all_reached = bool(self._waypoints) and not self._jumps and self.reached == self.waypoints
        return self._reported_complete or all_reached

    @property
    def on_ground(self) -> bool:
        return self.landed_state == _LANDED_ON_GROUND

    def on_item_reached(self, message: Any) -> None:
        self._reached[message.seq - self.first_seq] = None

    def on_mission_current(self, message: Any) -> None:
        self.current = message.seq - self.first_seq
        if self.flown and message.mission_state == _MISSION_STATE_COMPLETE:
            self._reported_complete = True

    def on_extended_sys_state(self, message: Any) -> None:
        self.landed_state = message.landed_state
        if message.landed_state in _LANDED_IN_AIR:
            self.flown = True

    def on_landed(self) -> None:
        """Count the last landing as reached at the end of the flight, even without the vehicle's report."""
        last = self._final_landing
        if last is not None and self.current == last and self.reached == self.waypoints - 1:
            self._reached[last] = None
