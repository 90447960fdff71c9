"""Obstacles on straight courses: distances in closed form, free courses, people, and a limit of poses."""

from __future__ import annotations

import pytest

from sim.physics import course
from sim.physics.course import obstacles
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import Box, load_scene

X500 = load_vehicle("x500")
WALL = Box(name="wall", center_m=(10.0, 0.0, 2.0), size_m=(1.0, 6.0, 4.0))
SCENE = load_scene("airfield").model_copy(update={"boxes": (WALL,)})


def test_the_way_to_a_wall_is_told() -> None:
    (found,) = obstacles(SCENE, X500, [((0.0, 0.0, 2.0), (20.0, 0.0, 2.0))])
    assert (found.course, found.name) == (0, "'wall'")
    assert 9.5 - X500.bounding_radius_m <= found.after_m < 9.5
    assert found.p_W == pytest.approx((found.after_m, 0.0, 2.0))


@pytest.mark.parametrize(
    "way",
    [
        ((0.0, 0.0, 4.6), (20.0, 0.0, 4.6)),  # over it
        ((0.0, 3.9, 2.0), (20.0, 3.9, 2.0)),  # past it
        ((0.0, 0.0, 2.0), (8.9, 0.0, 2.0)),  # before it
        ((0.0, 0.0, 2.0), (0.0, 0.0, 2.0)),  # nowhere
    ],
)
def test_a_free_course_has_no_obstacle(way: tuple[tuple[float, float, float], tuple[float, float, float]]) -> None:
    assert list(obstacles(SCENE, X500, [way])) == []


def test_a_course_that_ends_inside_and_one_along_the_ground_are_told_in_their_order() -> None:
    free = ((0.0, 5.0, 2.0), (3.0, 5.0, 2.0))
    inside = ((10.0, 0.0, 8.0), (10.0, 0.0, 3.0))
    low = ((0.0, 0.0, 0.05), (3.0, 0.0, 0.05))
    found = list(obstacles(SCENE, X500, [free, inside, low]))
    assert [each.course for each in found] == [1, 2]
    assert found[1].after_m == 0.0


def test_people_of_a_map_are_left_out() -> None:
    # Up from the ground the park's people walk on, over a path that they cross: nothing solid stands there.
    scene = load_scene("city_park")
    assert list(obstacles(scene, X500, [((0.0, 0.0, 1.0), (0.0, 0.0, 30.0))])) == []


def test_the_search_ends_after_its_number_of_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(course, "MAX_POSES", 5)
    assert list(obstacles(SCENE, X500, [((0.0, 0.0, 2.0), (20.0, 0.0, 2.0))])) == []
