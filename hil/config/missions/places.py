"""Mission items that name a place to fly to: one entry each, by the number of its MAV_CMD.

What an autopilot flies at a new one is written there; reading, checks, planned path and verdict follow from its entry.
"""

from __future__ import annotations

from typing import Literal, NamedTuple


class PlaceItem(NamedTuple):
    """Facts of one item. Parameters are given by their index, from 0."""

    name: str  # for messages
    role: Literal["waypoint", "take-off", "landing"] = "waypoint"
    waits: str = ""  # verb of the time in seconds in its first parameter; "": it has none
    radius_at: int | None = None  # radius of a loiter, negative: counter-clockwise
    accepts: bool = False  # the second parameter is its acceptance radius
    may_be_open: bool = False  # its place may be open (null, or 0, 0): that at which the vehicle then is


LOITER_TURNS, LOITER_TIME = 18, 19
PLACE_ITEMS = {
    16: PlaceItem("waypoint", waits="waits", accepts=True),
    17: PlaceItem("loiter", radius_at=2, may_be_open=True),
    LOITER_TURNS: PlaceItem("loiter turns", radius_at=2),
    LOITER_TIME: PlaceItem("loiter time", waits="loiters for", radius_at=2, may_be_open=True),
    31: PlaceItem("loiter to altitude", radius_at=1),
    82: PlaceItem("spline waypoint", waits="waits", accepts=True),
    22: PlaceItem("take-off", "take-off", may_be_open=True),
    84: PlaceItem("VTOL take-off", "take-off", may_be_open=True),
    21: PlaceItem("landing", "landing", may_be_open=True),
    85: PlaceItem("VTOL landing", "landing", may_be_open=True),
}

WAYPOINT_COMMANDS, TAKEOFF_COMMANDS, LAND_COMMANDS = (
    {command: item.name for command, item in PLACE_ITEMS.items() if item.role == role}
    for role in ("waypoint", "take-off", "landing")
)
PLACE_COMMANDS = {command: item.name for command, item in PLACE_ITEMS.items()}
MAY_BE_OPEN = frozenset(command for command, item in PLACE_ITEMS.items() if item.may_be_open)
TIMES = {command: item.waits for command, item in PLACE_ITEMS.items() if item.waits}
LOITER_RADII = {command: item.radius_at for command, item in PLACE_ITEMS.items() if item.radius_at is not None}
ACCEPTING = frozenset(command for command, item in PLACE_ITEMS.items() if item.accepts)
