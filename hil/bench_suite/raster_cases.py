"""What `hil bench raster` looks at: the four scenes, fields of random geoms, and flight-like viewpoints in them.

Viewpoints are random but for their seed: 2 to 30 m up (as far as the scene lets them), a third level, a third looking
down by 20 to 60 degrees, a third straight down to 30 degrees off; at least half a metre from everything, in nothing,
and each at another time, so that the actors stand elsewhere in every picture. The camera moves as a drone does.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.signals.errors import HilError
from hil.signals.samples import Vec3
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import CameraPose
from sim.scene.scene import load_scene
from sim.scene.world import World, load_world

Float64 = NDArray[np.float64]
SCENES = ("city_park", "urban_delivery", "training_village", "radar_range")
GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # what a camera sees
_CLEAR_M = 0.5
_LOW_M, _HIGH_M = 2.0, 30.0
_TRIES = 200  # for each view
_FIELD_SCENE = """\
name: field
description: random geoms
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: field.xml}
"""


@dataclass(frozen=True)
class View:
    """One picture to take."""

    t_ns: int
    pose: CameraPose


@dataclass(frozen=True)
class Case:
    """A world and the pictures to take in it."""

    name: str
    world: World
    views: tuple[View, ...]


def scene_case(name: str, *, views: int, seed: int) -> Case:
    """One of SCENES, or the path of a scene file."""
    world = load_world(load_scene(name))
    return Case(name, world, viewpoints(world, views, seed))


def viewpoints(world: World, count: int, seed: int) -> tuple[View, ...]:
    """`count` viewpoints in the world. The same world, count and seed give the same ones."""
    random = np.random.Generator(np.random.Philox(seed))
    posed = WorldPose(world)
    low, high = _extent(world.model, posed.data)
    views: list[View] = []
    for _ in range(_TRIES * count):
        if len(views) == count:
            break
        t_ns = int(random.integers(0, 60_000_000_000))
        height = _LOW_M + (_HIGH_M - _LOW_M) * random.random() ** 2  # more of them low, where there is more to see
        p_W = np.array([*random.uniform(low, high), height])
        kind = len(views) % 3
        down_deg = (random.uniform(-5, 5), random.uniform(20, 60), random.uniform(60, 90))[kind]
        R_WC = looking(random.uniform(-180, 180), down_deg, roll_deg=random.uniform(-5, 5))
        if not _clear(world.model, posed.at(t_ns), p_W):
            continue
        v_W, w_W = random.normal(0.0, 4.0, 3), random.normal(0.0, 0.5, 3)
        views.append(View(t_ns, camera_pose(p_W, R_WC, v_W, w_W)))
    else:
        raise HilError(f"{world.scene.name}: no {count} viewpoints found that are clear of everything")
    return tuple(views)


def looking(azimuth_deg: float, down_deg: float, *, roll_deg: float = 0.0) -> Float64:
    """R_WC of a camera that looks along the azimuth (from east, counter-clockwise) and `down_deg` below the horizon."""
    a, e, r = np.deg2rad([azimuth_deg, down_deg, roll_deg])
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    level_right = np.array([np.sin(a), -np.cos(a), 0.0])
    level_down = np.cross(forward, level_right)
    right = np.cos(r) * level_right + np.sin(r) * level_down
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def camera_pose(
    p_W: Float64, R_WC: Float64, v_W: Sequence[float] | Float64 = (0, 0, 0), w_W: Sequence[float] | Float64 = (0, 0, 0)
) -> CameraPose:
    """A CameraPose out of arrays."""
    a, b, c, d, e, f, g, h, i = np.asarray(R_WC, np.float64).ravel().tolist()
    return CameraPose(_vec3(p_W), (a, b, c, d, e, f, g, h, i), _vec3(v_W), _vec3(w_W))


def _vec3(values: Sequence[float] | Float64) -> Vec3:
    x, y, z = values
    return float(x), float(y), float(z)


def world_of(mjcf: str) -> World:
    """A World of an MJCF text, the way a user's file becomes one."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "field.xml").write_text(mjcf)
        scene = Path(folder, "field.yaml")
        scene.write_text(_FIELD_SCENE)
        return load_world(load_scene(str(scene)))


def world_with(geoms: Sequence[str]) -> World:
    """A World of geoms over a plane, in the sun."""
    return world_of(
        '<mujoco><default><geom contype="0" conaffinity="0"/></default><worldbody>'
        '<light directional="true" dir="-0.4 0.3 -0.9" castshadow="true"/>'
        f'<geom name="ground" type="plane" size="0 0 1"/>{"".join(geoms)}</worldbody></mujoco>'
    )


def field_case(count: int, *, seed: int, views: int) -> Case:
    """`count` random primitives on 80 x 80 m, seen from the rim: more are seen, and more hide behind others."""
    random = np.random.Generator(np.random.Philox(seed))
    things = random_geoms(random, count, (-40, -40, 0.5), (40, 40, 12))
    poses = []
    for i in range(views):
        azimuth = 360.0 * i / views
        p_W = -50.0 * np.array([np.cos(np.deg2rad(azimuth)), np.sin(np.deg2rad(azimuth)), 0.0]) + [0, 0, 8.0]
        poses.append(View(i * 100_000_000, camera_pose(p_W, looking(azimuth, 10.0))))
    return Case(f"field of {count}", world_with(things), tuple(poses))


def hidden_case(visible: int, hidden: int, *, where: str, seed: int) -> Case:
    """`visible` geoms before the camera, a wall among them, and `hidden` more: "behind a wall" or "out of view"."""
    random = np.random.Generator(np.random.Philox(seed))
    things = random_geoms(random, visible - 1, (4, -8, 0.5), (24, 8, 10))
    things.append('<geom type="box" size="0.5 60 40" pos="30 0 30"/>')
    # Behind the wall: within its shadow as seen from the camera, x to 100 m. Out of view: behind the camera.
    box = ((32, -50, 1), (100, 50, 50)) if where == "behind a wall" else ((-100, -50, 1), (-5, 50, 50))
    things += random_geoms(random, hidden, *box)
    view = View(0, camera_pose(np.array([0.0, 0.0, 5.0]), looking(0.0, 0.0)))
    name = f"{visible} visible" + (f", {hidden} {where}" if hidden else "")
    return Case(name, world_with(things), (view,))


def random_geoms(
    random: np.random.Generator, count: int, low: Sequence[float], high: Sequence[float], *, largest_m: float = 0.6
) -> list[str]:
    """Primitives of all kinds, as MJCF."""
    kinds = (("sphere", 1), ("box", 3), ("capsule", 2), ("cylinder", 2), ("ellipsoid", 3))
    things = []
    for i in range(count):
        kind, sizes = kinds[i % len(kinds)]
        size, position = random.uniform(0.1, largest_m, sizes), random.uniform(low, high)
        turn, colour = random.normal(size=4), [*random.uniform(0.2, 1.0, 3), 1.0]
        things.append(
            f'<geom type="{kind}" size="{_text(size)}" pos="{_text(position)}" quat="{_text(turn)}" '
            f'rgba="{_text(colour)}"/>'
        )
    return things


def _text(values: Sequence[float] | Float64) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _extent(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Float64, Float64]:
    """Where the scene's things are, in x and y: the middle 90 % of their centres."""
    bounded = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_group < 3)
    centres = data.geom_xpos[bounded][:, :2] if bounded.any() else np.array([[-20.0, -20.0], [20.0, 20.0]])
    low, high = np.quantile(centres, 0.05, axis=0), np.quantile(centres, 0.95, axis=0)
    return np.minimum(low, -5.0), np.maximum(high, 5.0)


def _clear(model: mujoco.MjModel, data: mujoco.MjData, p_W: Float64) -> bool:
    """Nothing within half a metre, and p_W in no closed shape."""
    i = np.arange(256) + 0.5
    z, turn = 1.0 - i / 128.0, i * 2.399963229728653  # directions spread evenly, by the golden angle
    r = np.sqrt(1.0 - z * z)
    rays = np.ascontiguousarray(np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))
    geom, distance, normal = cast(model, data, p_W, rays)
    met = geom >= 0
    if met.any() and distance[met].min() < _CLEAR_M:
        return False
    # From inside a closed shape one sees the backs of its faces, from which mj_ray's normals point away.
    # Meshes may be open.
    away = np.einsum("ij,ij->i", normal, rays) > 1e-9
    solid = model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH
    return not bool((met & away & solid).any())


def cast(
    model: mujoco.MjModel, data: mujoco.MjData, origin_W: Float64, directions_W: Float64
) -> tuple[NDArray[np.int32], Float64, Float64]:
    """(n, 3) unit directions to geom (-1: none), distance [m] and normal, by mj_multiRay."""
    n = len(directions_W)
    geom, distance, normal = np.zeros(n, np.int32), np.zeros(n), np.zeros((n, 3))
    vectors = np.ascontiguousarray(directions_W, np.float64).reshape(-1)
    mujoco.mj_multiRay(
        model, data, np.asarray(origin_W, float), vectors, GROUPS, 1, -1, geom, distance, normal.reshape(-1), n, 1e10
    )
    return geom, distance, normal
