"""The airfield for planes: its runway is where the scene's file says, and the way to it and from it is free."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.scene.runway import Runway
from sim.scene.scene import load_scene
from sim.scene.solids import solid_geoms
from sim.world_loader import load_world

SCENE = load_scene("airstrip")
RUNWAY = SCENE.runway
assert RUNWAY is not None


def test_the_declared_runway_is_the_one_that_is_drawn() -> None:
    world = load_world(SCENE)
    geom = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_GEOM, "runway_000_strip")
    body = int(world.model.geom_bodyid[geom])
    middle = world.model.body_pos[body] + world.model.geom_pos[geom]
    half = world.model.geom_size[geom]
    assert tuple(middle[:2]) == pytest.approx(RUNWAY.at(0.5 * RUNWAY.length_m)[:2], abs=1e-9)
    assert (2.0 * half[0], 2.0 * half[1]) == pytest.approx((RUNWAY.length_m, RUNWAY.width_m))
    assert RUNWAY.direction_W == pytest.approx((1.0, 0.0), abs=1e-12)
    assert world.model.geom_contype[geom] == 0  # wheels roll on the ground below, at z = 0
    assert 0.0 < middle[2] + half[2] < 0.005


def test_the_start_is_on_its_centre_line_behind_the_threshold() -> None:
    assert RUNWAY.place_of((0.0, 0.0, 0.5)) == pytest.approx((10.0, 0.0, 0.5), abs=1e-9)
    assert RUNWAY.contains((0.0, 0.0, 0.0))
    assert RUNWAY.length_m >= 300.0


def test_nothing_solid_stands_on_the_way_in_and_out() -> None:
    world = load_world(SCENE)
    solids = solid_geoms(world)
    radius = world.model.geom_rbound[solids.geom]
    for geom, (x, y, z), reach in zip(solids.geom, solids.position, radius, strict=True):
        if world.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        along, right, _ = RUNWAY.place_of((x, y, z))
        beside = abs(right) - min(reach, 12.0)  # long rails and walls lie along the runway
        if -60.0 <= along <= RUNWAY.length_m + 60.0:
            assert beside > 30.0, (geom, x, y)
        if -400.0 <= along < 0.0:
            assert beside > 60.0, (geom, x, y)
        if RUNWAY.length_m < along < RUNWAY.length_m + 105.0:
            assert beside > 45.0, (geom, x, y)


def test_classes_of_the_airfield() -> None:
    world = load_world(SCENE)
    names = set(world.class_names)
    assert {"runway", "marking", "pavement", "grass", "hall", "fence", "pole", "windsock", "tree", "hedge"} <= names
    assert "field" not in names


@given(
    heading=st.floats(0.0, 359.9),
    along=st.floats(-500.0, 900.0),
    right=st.floats(-80.0, 80.0),
    up=st.floats(-5.0, 99.0),
)
def test_places_along_a_runway_come_back(heading: float, along: float, right: float, up: float) -> None:
    runway = Runway(threshold_m=(30.0, -12.0), heading_deg=heading, length_m=500.0, width_m=20.0, elevation_m=3.0)
    assert runway.place_of(runway.at(along, right, up)) == pytest.approx((along, right, up), abs=1e-9)
    e, n = runway.direction_W
    turn = (math.degrees(math.atan2(e, n)) - heading + 180.0) % 360.0 - 180.0
    assert turn == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(e, n) == pytest.approx(1.0, abs=1e-12)
    if min(abs(along), abs(along - 500.0), abs(abs(right) - 10.0)) > 1e-9:
        assert runway.contains(runway.at(along, right, up)) == (0.0 < along < 500.0 and abs(right) < 10.0)
