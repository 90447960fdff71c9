"""Parked cars and small objects along kerbs: where they stand, what they are called, and that nothing else moves."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from sim.scene.maps.catalog import GENERATORS
from sim.scene.scene_map import SceneMap

_CARS, _OBJECTS = 24, 20
_CLASSES = {"cone": "barrier", "cabinet": "furniture", "bollard": "pole"}
_SMALL = ("bin", "cone", "sign", "cabinet", "bollard")
_OFF = {"city_park": {"parked_cars": 0, "street_objects": 0}, "urban_delivery": {"street_objects": 0}}
_ON = {"city_park": {"parked_cars": _CARS, "street_objects": _OBJECTS}, "urban_delivery": {"street_objects": _OBJECTS}}


@cache
def made(name: str, seed: int, which: str) -> SceneMap:
    generator = GENERATORS[name]
    settings: dict[str, Any] = {"on": _ON, "off": _OFF}[which][name]
    return generator.generate(generator.parameters(**settings), seed)


def bodies(scene_map: SceneMap) -> dict[str, mujoco.MjsBody]:
    spec = mujoco.MjSpec.from_string(scene_map.mjcf, assets=dict(scene_map.assets))
    return {body.name: body for body in spec.worldbody.bodies}


def boxes(scene_map: SceneMap, prefix: str) -> dict[str, np.ndarray]:
    """Return the corners (4, 2) of the oriented ground plan of each body whose name begins with `prefix`."""
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, np.ndarray] = {}
    for body in range(1, model.nbody):
        name = model.body(body).name
        if not re.fullmatch(prefix, name):
            continue
        points = []
        for geom in np.flatnonzero(model.geom_bodyid == body):
            turn = data.xmat[body].reshape(3, 3).T @ data.geom_xmat[geom].reshape(3, 3)
            at = data.xmat[body].reshape(3, 3).T @ (data.geom_xpos[geom] - data.xpos[body])
            middle = at + turn @ model.geom_aabb[geom, :3]
            reach = np.abs(turn) @ model.geom_aabb[geom, 3:]
            points += [middle - reach, middle + reach]
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
        found[name] = corners @ data.xmat[body].reshape(3, 3)[:2, :2].T + data.xpos[body, :2]
    return found


def apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Return True if two convex polygons do not meet: an edge of one separates them."""
    for p, q in ((a, b), (b, a)):
        edges = np.roll(p, -1, axis=0) - p
        outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        sides = np.einsum("ejk,ek->ej", q[None] - p[:, None], outward)
        if (sides.min(axis=1) > 0.0).any():
            return True
    return False


@pytest.mark.parametrize("name", _OFF)
@pytest.mark.parametrize("seed", [1, 7])
def test_nothing_else_moves(name: str, seed: int) -> None:
    without, with_all = bodies(made(name, seed, "off")), bodies(made(name, seed, "on"))
    assert with_all.keys() > without.keys()
    for key, body in without.items():
        assert np.array_equal(body.pos, with_all[key].pos), key
        assert np.array_equal(body.quat, with_all[key].quat), key
    more = {re.sub(r"_\d+$", "", key) for key in with_all.keys() - without.keys()}
    assert more <= {*_SMALL, *(("car", "van") if name == "city_park" else ())}


@pytest.mark.parametrize("seed", [1, 7, 23])
def test_cars_of_the_park_stand_at_kerbs_and_apart(seed: int) -> None:
    scene_map = made("city_park", seed, "on")
    cars = boxes(scene_map, r"(car|van)_\d+")
    assert len(cars) == 3 + _CARS
    for name, corners in cars.items():
        out = np.abs(corners).max(axis=1)
        assert out.min() > 49.0, name  # the street: 49 to 56 m from the axes
        assert out.max() < 56.0, name
    names = list(cars)
    for i, first in enumerate(names):
        for second in names[:i]:
            assert apart(cars[first], cars[second]), (first, second)


@pytest.mark.parametrize("name", _OFF)
@pytest.mark.parametrize("seed", [1, 7])
def test_small_objects_stand_on_pavements_and_have_classes(name: str, seed: int) -> None:
    scene_map = made(name, seed, "on")
    old = bodies(made(name, seed, "off"))
    added = {key: body for key, body in bodies(scene_map).items() if key not in old and key.startswith(_SMALL)}
    assert len(added) > _OBJECTS / 2
    for key, body in added.items():
        assert body.pos[2] == pytest.approx(0.12), key  # the top of the pavement
        kind = re.sub(r"_\d+$", "", key)
        assert f"{kind}_*" in scene_map.classes[_CLASSES.get(kind, kind)]
    plans = boxes(scene_map, "|".join(added))
    cars = boxes(scene_map, r"(car|van)_\d+")  # mirrors of lorries and buses are above the pavement
    for key, corners in plans.items():
        assert all(apart(corners, car) for car in cars.values()), key


def test_a_bad_overlap_would_be_seen() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert not apart(square, square + 0.9)
    assert apart(square, square + np.array([1.1, 0.0]))


def test_more_cars_move_no_object() -> None:
    generator = GENERATORS["city_park"]
    few, many = (
        bodies(generator.generate(generator.parameters(parked_cars=count, street_objects=8), 3)) for count in (0, 4)
    )
    for key in few:
        if key.startswith(_SMALL):
            assert np.array_equal(few[key].pos, many[key].pos), key
