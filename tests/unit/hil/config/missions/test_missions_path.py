"""Legs of a mission in metres."""

from __future__ import annotations

import itertools
from pathlib import Path

import pymap3d
import pytest

from hil.config.missions import Mission
from hil.config.missions.path import MAX_LEGS, LegKind, planned_path
from signals.mission import MissionItem
from sim.scene.scene import Scene, Site

SITE = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
SCENE = Scene(name="s", description="", site=SITE, ground_friction=1.0)
HOME = (1.0, 2.0, 0.25)


def item(command: int, east: float = 0.0, north: float = 0.0, alt: float = 0.0, *, frame: int = 3, p1: float = 0.0,
         p2: float = 0.0) -> MissionItem:  # fmt: skip
    latitude, longitude, _ = pymap3d.enu2geodetic(east, north, 0, SITE.latitude_deg, SITE.longitude_deg, 488.0)
    return MissionItem(0, frame, command, 0, 1, p1, p2, 0.0, 0.0, round(latitude * 1e7), round(longitude * 1e7), alt)


def legs(*items: MissionItem):  # type: ignore[no-untyped-def]
    numbered = tuple(i._replace(seq=n) for n, i in enumerate(items))
    return planned_path(Mission(Path("m"), numbered), SCENE, home_W=HOME)


def test_a_flight_from_take_off_to_landing() -> None:
    path = legs(item(22, 1, 2, 10), item(178, frame=2), item(16, 40, 2, 10, p2=0.5), item(21, 1, 2, 0))
    assert [leg.kind for leg in path] == [LegKind.CLIMB, LegKind.FLY, LegKind.APPROACH, LegKind.DESCENT]
    assert [leg.seq for leg in path] == [0, 2, 3, 3]
    assert path[0].start_W == HOME
    assert path[1].end_W == pytest.approx((40, 2, 10.25), abs=0.02)  # 1e-7 deg is a centimetre
    assert path[3].end_W == pytest.approx(HOME, abs=0.02)
    assert [leg.acceptance_radius_m for leg in path[:2]] == [2.0, 0.5]
    assert all(one.end_W == two.start_W for one, two in itertools.pairwise(path))


def test_a_waypoint_counts_no_farther_than_half_of_the_way_to_it() -> None:
    named = (1e9, 10.0, 6.0, 1e9, 5.0, 5.0, 0.0)
    ends = (101, 101, 111, 111, 211, 211, 251)  # from home at 1
    path = legs(*(item(16, east, 2, 10, p2=radius) for east, radius in zip(ends, named, strict=True)))
    radii = [leg.acceptance_radius_m for leg in path]
    assert radii == pytest.approx([50, 10, 5, 5, 5, 5, 2], abs=0.02)


def test_close_waypoints_do_not_take_over_the_radius_of_a_long_leg() -> None:
    """Thirty waypoints 1.9 m apart after a leg of 100 m had its 50 m, and all counted at once."""
    path = legs(item(16, 101, 2, 10, p2=1e9), *(item(16, 101, 2 + 1.9 * i, 10, p2=1e9) for i in range(1, 31)))
    first, *others = (leg.acceptance_radius_m for leg in path)
    assert first == pytest.approx(50, abs=0.02)
    assert others == [2.0] * 30


def test_heights_count_from_home_sea_level_or_ground() -> None:
    path = legs(item(16, 10, 0, 20, frame=3), item(16, 20, 0, 500, frame=0), item(16, 30, 0, 20, frame=10))
    assert [leg.end_W[2] for leg in path] == [20.25, 12.0, 20.0]


def test_open_places_and_return() -> None:
    nowhere = MissionItem(0, 3, 22, 0, 1, 0, 0, 0, 0, 0, 0, 5.0)
    path = legs(nowhere, item(16, 30, 0, 8), item(20, frame=2))
    assert path[0].end_W == (1.0, 2.0, 5.25)
    assert [leg.kind for leg in path[2:]] == [LegKind.RETURN, LegKind.DESCENT]
    assert path[-1].end_W == HOME
    here = nowhere._replace(command=21, alt_m=0.0)
    assert legs(item(16, 30, 0, 8), here)[-1].end_W == pytest.approx((30, 0, 0.25), abs=0.02)


def test_a_home_that_the_plan_sets_is_home_from_then_on() -> None:
    take_off, there = item(22, 1, 2, 10), item(16, 41, 2, 10)
    here, named = item(179, p1=1.0), item(179, 21, 2, 490.0, frame=0)
    path = legs(take_off, there, here, item(16, 41, 22, 10), item(20))
    assert path[2].end_W == pytest.approx((41, 22, 20.25), abs=0.02)  # above the vehicle's place
    assert path[-1].end_W == pytest.approx((41, 2, 0.25), abs=0.02)
    path = legs(take_off, there, named, item(16, 41, 22, 10), item(20))
    assert path[2].end_W == pytest.approx((41, 22, 12), abs=0.02)
    assert path[-1].end_W == pytest.approx((21, 2, 0.25), abs=0.02)


def test_jumps_are_followed_as_often_as_they_say_and_endless_ones_end() -> None:
    square = (item(16, 0, 0, 5), item(16, 10, 0, 5))
    assert [leg.seq for leg in legs(*square, item(177, frame=2, p1=0, p2=2))] == [0, 1, 0, 1, 0, 1]
    *_, last, end = endless = legs(*square, item(177, frame=2, p1=0, p2=-1), item(21))
    assert len(endless) == MAX_LEGS + 1
    assert (last.kind, end.kind, end.seq) == (LegKind.FLY, LegKind.ENDLESS, 2)
    assert [leg.kind for leg in legs(item(177, frame=2, p1=0, p2=-1))] == [LegKind.ENDLESS]


def test_the_time_to_wait_of_an_item_and_of_the_delays_after_it() -> None:
    """Delays were no part of the plan that a flight is judged by. After a transition a VTOL is elsewhere."""
    delay, transition = item(93, frame=2, p1=7.0), item(3000, frame=2, p1=4.0)
    path = legs(
        item(93, frame=2, p1=9.0), item(22, 1, 2, 10), delay, item(19, 20, 2, 10, p1=5.0), delay, item(93, p1=-1.0),
        item(177, frame=2, p1=4, p2=1), item(16, 30, 2, 10, p1=3.0), transition, delay, item(17, 1, 2, 10),
        item(21, 1, 2),
    )  # fmt: skip
    assert [leg.wait_s for leg in path if leg.kind in (LegKind.CLIMB, LegKind.FLY)] == [7.0, 19.0, 3.0, 0.0]


def test_the_circles_of_an_item() -> None:
    one, other = item(18, 20, 2, 10, p1=2.0), item(18, 20, 2, 10, p1=float("nan"))
    path = legs(item(22, 1, 2, 10), one, one._replace(param3=-5.0), other, item(16, 30, 2, 10, p1=3.0))
    assert [leg.turns for leg in path] == [0.0, 2.0, -2.0, 1.0, 0.0]


def test_the_speed_that_the_plan_commands_of_the_legs_behind_it() -> None:
    speeds = ((1.0, 3.0), (0.0, 5.0), (2.0, 1.0), (1.0, 4.0), (1.0, -1.0), (1.0, 2.0), (1.0, -2.0))
    items = [item(22, 1, 2, 10)]
    for east, (kind, speed_mps) in enumerate(speeds):
        items += [item(178, frame=2, p1=kind, p2=speed_mps), item(16, 40 * east, 2, 10)]
    path = legs(*items, item(21, 1, 2, 0))
    # That of a climb is, for PX4, one over ground, too; -1 is its own, and for others that of before.
    assert [leg.speed_mps for leg in path] == [0.0, 3.0, 5.0, 0.0, 4.0, 0.0, 2.0, 0.0, 0.0, 0.0]
