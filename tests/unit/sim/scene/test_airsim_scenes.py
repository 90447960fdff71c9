"""Scenes for scripts of AirSim: what their fixed coordinates need is free, and what they name exists."""

from __future__ import annotations

import itertools
import re
from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import surfaces
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.landscape_mountains import terrain
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.scene import load_scene
from sim.sensors.ground_range import rays_into

GEOM = mujoco.mjtObj.mjOBJ_GEOM
BODY = mujoco.mjtObj.mjOBJ_BODY
Point = tuple[float, float, float]
# AirSim's example path.py, 5 m above the start: north 125, west 130, and back; here (east, north, up).
PATH: tuple[Point, ...] = ((0, 0, 5), (0, 125, 5), (-130, 125, 5), (-130, 0, 5), (0, 0, 5))
SURVEY: tuple[Point, ...] = tuple((s * 57.0, x, 30.0) for x in range(-50, 58, 10) for s in (-1.0, 1.0))
BOX: tuple[Point, ...] = ((0, 0, 20), (20, 0, 20), (20, 20, 20), (-20, 20, 20), (-20, -20, 20), (20, -20, 20))
GIMBAL: tuple[Point, ...] = ((50.26, -50.0, 20.58), (-50.26, 50.0, 10.58))
HELLO: tuple[Point, ...] = ((0, 0, 0.4), (0, 0, 2), (10, -10, 10), (5, 5, 10), (-5, -5, 10), (-6, 6, 7))


@cache
def compiled(name: str, seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    generator = GENERATORS[name]
    scene_map = generator.generate(generator.parameters(), seed)
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def touched(name: str, seed: int, path: tuple[Point, ...], radius_m: float) -> set[str]:
    """Return the bodies that a ball of this radius touches on its way along a path."""
    model, data = compiled(name, seed)
    names: set[str] = set()
    for start, end in itertools.pairwise(path):
        length = float(np.linalg.norm(np.subtract(end, start)))
        for u in np.linspace(0.0, 1.0, int(length / (0.5 * radius_m)) + 2):
            centre = np.array(start) + u * np.subtract(end, start)
            names |= near(model, data, centre, radius_m)
    return names


def near(model: mujoco.MjModel, data: mujoco.MjData, centre: NDArray[np.float64], radius_m: float) -> set[str]:
    """Return the bodies of solid geoms whose own (oriented) box comes within `radius_m` of a point."""
    rotation = data.geom_xmat.reshape(-1, 3, 3)
    local = np.einsum("gji,gj->gi", rotation, centre - data.geom_xpos) - model.geom_aabb[:, :3]
    gap = np.linalg.norm(np.maximum(np.abs(local) - model.geom_aabb[:, 3:], 0.0), axis=1)
    of_body = (model.geom_contype == 1) & (model.geom_bodyid > 0)
    return {
        str(mujoco.mj_id2name(model, BODY, int(model.geom_bodyid[g])))
        for g in np.flatnonzero(of_body & (gap < radius_m))
    }


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("path", "radius_m"), [(PATH, 3.0), (SURVEY, 4.0), (BOX, 3.0), (GIMBAL, 1.5), (HELLO, 1.0)],
    ids=("path", "survey", "box", "gimbal", "hello"),
)  # fmt: skip
def test_the_moves_of_the_examples_meet_nothing_in_blocks(path: tuple[Point, ...], radius_m: float, seed: int) -> None:
    assert touched("blocks", seed, path, radius_m) == set()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_ball_of_two_metres_follows_the_path_along_the_streets_of_the_neighbourhood(seed: int) -> None:
    assert touched("airsim_nh", seed, PATH, 2.0) == set()
    model, data = compiled("airsim_nh", seed)
    below = [
        (np.array(start) + u * np.subtract(end, start)) for start, end in itertools.pairwise(PATH) for u in (0.3, 0.7)
    ]
    hit = np.zeros(1, dtype=np.int32)
    for at in below:
        groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        mujoco.mj_ray(model, data, at, np.array([0.0, 0.0, -1.0]), groups, 1, -1, hit)
        name = str(mujoco.mj_id2name(model, BODY, int(model.geom_bodyid[hit[0]])))
        assert name.split("_")[0] in {"road", "marking"}, at


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("towards", [(0, 1), (1, 0), (0, -1), (-1, 0)], ids=["north", "east", "south", "west"])
def test_the_neighbourhood_has_houses_on_all_sides_of_the_start(towards: tuple[int, int], seed: int) -> None:
    model, data = compiled("airsim_nh", seed)
    names = [str(mujoco.mj_id2name(model, BODY, i)) for i in range(model.nbody)]
    houses = np.array([data.xpos[i, :2] for i, name in enumerate(names) if name.startswith("house_")])
    along, across = houses @ np.array(towards), houses @ np.array([-towards[1], towards[0]])
    ahead = along[np.abs(across) < 60.0]
    for near, far in ((0.0, 50.0), (50.0, 100.0), (100.0, 140.0), (140.0, 165.0)):
        assert np.any((near < ahead) & (ahead < far)), (near, far)


@pytest.mark.parametrize("seed", range(1, 9))
def test_blocks_keep_the_free_room_and_the_heights_of_the_documentation(seed: int) -> None:
    model, data = compiled("blocks", seed)
    turned = data.geom_xmat.reshape(-1, 3, 3)
    middle = data.geom_xpos + np.einsum("gij,gj->gi", turned, model.geom_aabb[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(turned), model.geom_aabb[:, 3:])
    middle, half = middle[model.geom_bodyid > 0], half[model.geom_bodyid > 0]
    tops = (middle + half)[:, 2]

    def beside(x: float, y: float) -> NDArray[np.float64]:
        """Return the horizontal distance of each geom's box from a point."""
        gap = np.maximum(np.abs(middle[:, :2] - (x, y)) - half[:, :2], 0.0)
        return np.asarray(np.hypot(gap[:, 0], gap[:, 1]))

    assert beside(0.0, 0.0).min() >= 14.0
    assert tops[beside(0.0, 0.0) < 50.0].max() <= 6.0
    assert tops[beside(0.0, 0.0) < 85.0].max() <= 18.0
    for start, end in itertools.pairwise(PATH):
        for u in np.linspace(0.0, 1.0, 131):
            x, y, _ = np.array(start) + u * np.subtract(end, start)
            assert beside(x, y).min() >= 4.0


def test_blocks_hold_what_scripts_name_and_a_wall_ends_the_lane_north() -> None:
    model, data = compiled("blocks", 1)
    bodies = {str(mujoco.mj_id2name(model, BODY, i)) for i in range(1, model.nbody)}
    assert {"OrangeBall", "PulsingCone", "Cone_5", "Cylinder_3", "TemplateCube_Rounded_16"} <= bodies
    assert {f"TemplateCube_Rounded_{i}" for i in range(1, 161)} <= bodies
    assert mujoco.mj_name2id(model, GEOM, "Ground") >= 0
    # Straight ahead the free lane ends at a wall.
    hit = np.zeros(1, dtype=np.int32)
    distance = mujoco.mj_ray(model, data, np.array([0.0, 0.0, 5.0]), np.array([0.0, 1.0, 0.0]), None, 1, -1, hit)
    assert 138.0 < distance < 150.0


def test_cubes_are_closed_and_their_faces_look_outwards() -> None:
    model, _ = compiled("blocks", 1)
    for mesh in range(model.nmesh):
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        start, vertices = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        corners = model.mesh_vert[start : start + vertices][model.mesh_face[first : first + count]].astype(float)
        middle = model.mesh_vert[start : start + vertices].mean(axis=0)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sizes = np.linalg.norm(normals, axis=1)
        outward = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - middle)
        assert (outward[sizes > 1e-9] > 0.0).all(), mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MESH, mesh)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_valley_is_level_at_the_start_and_keeps_its_greatest_and_least_height(seed: int) -> None:
    height = terrain(seed)
    assert (height.min(), height.max()) == (-16.0, 240.0)  # or MuJoCo would scale it
    assert (height[47:50, 63:66] == 0.0).all()


@pytest.mark.parametrize("scene", ["blocks", "airsim_nh", "landscape_mountains"])
def test_rays_straight_down_find_the_ground_at_round_places(scene: str) -> None:
    rays = rays_into(load_scene(scene))
    for x, y in ((0.0, 0.0), (0.0, 40.0), (-30.0, 0.0), (20.0, 20.0), (-10.0, 10.0), (0.0, 9.375)):
        assert 0.0 < rays.ray_distance((x, y, 60.0), (0.0, 0.0, -1.0)) <= 61.0, (x, y)
    assert rays.ray_distance((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)) == pytest.approx(2.0, abs=0.02)


def test_the_ground_of_the_valley_is_solid_where_it_is_drawn() -> None:
    model, data = compiled("landscape_mountains", 1)
    ground = mujoco.mj_name2id(model, BODY, "Landscape_0")
    groups = np.where(model.geom_bodyid == ground, model.geom_group, 5)
    rng = np.random.default_rng(3)
    hit, down = np.zeros(1, dtype=np.int32), np.array([0.0, 0.0, -1.0])
    saved = model.geom_group.copy()
    model.geom_group[:] = groups
    try:
        for x, y in rng.uniform((-590.0, -440.0), (590.0, 740.0), (400, 2)):
            above = np.array([x, y, 300.0])
            heights = []
            for group in (0, 3):
                only = np.array([k == group for k in range(6)], dtype=np.uint8)
                heights.append(300.0 - mujoco.mj_ray(model, data, above, down, only, 1, -1, hit))
            assert heights[0] == pytest.approx(heights[1], abs=0.01), (x, y)
    finally:
        model.geom_group[:] = saved


def test_the_wires_hang_six_to_nine_metres_below_the_path_of_the_example() -> None:
    model, data = compiled("landscape_mountains", 1)
    points = [(-31.98, -0.55, 19.02), (-63.33, 48.6, 60.07), (-55.08, 193.6, 46.32), (35.32, 369.25, 62.57)]
    points.append((143.67, 541.35, 32.07))
    wires = [g for g in range(model.ngeom) if str(mujoco.mj_id2name(model, GEOM, g)).startswith("wire_")]
    half_m = data.geom_xmat[wires].reshape(-1, 3, 3)[:, :, 2] * model.geom_size[wires, 1][:, None]
    starts, steps = data.geom_xpos[wires] - half_m, 2.0 * half_m
    lengths2 = (steps[:, :2] ** 2).sum(axis=1)
    below_m = []
    for start, end in itertools.pairwise(points):
        for u in np.linspace(0.0, 1.0, 41):
            at = np.array(start) + u * np.subtract(end, start)
            along = np.clip(((at - starts)[:, :2] * steps[:, :2]).sum(axis=1) / lengths2, 0.0, 1.0)
            nearest = starts + along[:, None] * steps
            beside = np.linalg.norm((nearest - at)[:, :2], axis=1)
            assert beside.min() < 0.1  # the middle wire
            below_m.append(at[2] - nearest[beside.argmin(), 2])
    assert (min(below_m), max(below_m)) == pytest.approx((6.0, 9.0), abs=0.1)


def test_a_height_field_lies_as_its_rows_say() -> None:
    builder = MapBuilder("slope")
    builder.material("grass", surfaces.GRASS)
    builder.hfield("slope", [[0.0, 0.0], [1.0, 1.0]], (10.0, 10.0, 5.0, 1.0))
    builder.ground_hfield("slope", material="grass", pos=(0.0, 0.0, 0.0))
    model = mujoco.MjModel.from_xml_string(builder.build().mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hit = np.zeros(1, dtype=np.int32)
    for y in (-8.0, 8.0):
        z = 9.0 - mujoco.mj_ray(model, data, np.array([0.0, y, 9.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, hit)
        assert z == pytest.approx(0.25 * (y + 10.0), abs=1e-4)


@pytest.mark.parametrize("name", ["blocks", "airsim_nh", "landscape_mountains"])
def test_names_of_bodies_are_words_of_letters_digits_and_underscores(name: str) -> None:
    model, _ = compiled(name, 1)
    assert all(re.fullmatch(r"\w+", str(mujoco.mj_id2name(model, BODY, i))) for i in range(1, model.nbody))
