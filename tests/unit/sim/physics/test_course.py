"""Obstacles on straight courses: distances in closed form, free courses, and what moves."""

from __future__ import annotations

import mujoco
import pytest

from sim.physics.contact_model import build_model
from sim.physics.course import obstacles
from sim.physics.take_off import CONTACT_STEP_S
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


def test_what_moves_is_left_out() -> None:
    scene, p_W = load_scene("city_park"), (0.0, 0.0, 0.3)
    model = build_model(scene, X500, contact_step_s=CONTACT_STEP_S)
    data = mujoco.MjData(model)  # its people, not yet posed, all stand at the origin, over the free ground
    data.qpos[:] = (*p_W, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    touched = {int(model.geom_bodyid[geom]) for contact in data.contact if contact.dist < 0.0 for geom in contact.geom}
    assert any(model.body_mocapid[body] >= 0 for body in touched)
    assert list(obstacles(scene, X500, [(p_W, p_W)])) == []
