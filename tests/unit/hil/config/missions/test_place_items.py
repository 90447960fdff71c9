"""Facts of mission items that name a place: a new item is one entry of `PLACE_ITEMS`."""

from __future__ import annotations

import math

from hil.config.missions import places
from hil.config.missions.item_values import wrong_values


def test_each_item_is_a_waypoint_a_take_off_or_a_landing() -> None:
    by_role = (places.WAYPOINT_COMMANDS, places.TAKEOFF_COMMANDS, places.LAND_COMMANDS)
    assert [sorted(each) for each in by_role] == [[16, 17, 18, 19, 31, 82], [22, 84], [21, 85]]
    assert sorted(places.PLACE_COMMANDS) == sorted(command for each in by_role for command in each)
    assert places.PLACE_COMMANDS.keys() == places.PLACE_ITEMS.keys()


def test_facts_of_the_items_are_those_of_mavlink() -> None:
    assert places.TIMES.keys() == {16, 19, 82}
    assert places.LOITER_RADII == {17: 2, 18: 2, 19: 2, 31: 1}
    assert sorted(places.ACCEPTING) == [16, 82]
    assert sorted(places.MAY_BE_OPEN) == [17, 19, 21, 22, 84, 85]


def test_values_are_checked_by_the_entry_of_the_item() -> None:
    params = [-1.0, -2.0, 20_000.0, math.nan]
    wrong = {command: [index for index, *_ in wrong_values(command, params)] for command in places.PLACE_ITEMS}
    assert wrong == {16: [0, 1], 17: [2], 18: [0, 2], 19: [0, 2], 31: [], 82: [0, 1], 22: [], 84: [], 21: [], 85: []}
