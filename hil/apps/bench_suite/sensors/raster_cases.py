"""Cases of `hil bench raster`: the four scenes, other vehicles, fields of random geoms, and viewpoints in them.

Viewpoints are random with a fixed seed, 2 to 30 m up: one third level, one third pointing 20 to 60 degrees down, one
third within 30 degrees of straight down. They are at least half a metre from all objects and outside them. Their times
differ, so that actors differ between pictures. The camera moves like a drone's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from signals.errors import HilError
from signals.samples import Vec3
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import CameraPose
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_bodies import VehicleBodies, with_vehicles
from sim.scene.scene import load_scene
from sim.scene.world import World
from sim.world_loader import load_world

Float64 = NDArray[np.float64]
SCENES = ("city_park", "urban_delivery", "training_village", "radar_range")
VEHICLES = "vehicles over city_park"
_SEEN = ("x500", "iris", "racer")
_CLEAR_M = 0.5
_MIN_HEIGHT_M, _MAX_HEIGHT_M = 2.0, 30.0
_TRIES = 200  # per view
_FIELD_SCENE = """\
name: field
description: random geoms
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: field.xml}
"""


@dataclass(frozen=True)
class View:
    """Time and camera pose of one picture."""

    t_ns: int
    pose: CameraPose


@dataclass(frozen=True)
class Case:
    """A world and the pictures to render in it."""

    name: str
    world: World
    views: tuple[View, ...]


def scene_case(name: str, *, views: int, seed: int) -> Case:
    """Return the case of a scene: one of SCENES, or the path of a scene file; or `vehicle_case`."""
    if name == VEHICLES:
        return vehicle_case(views=views, seed=seed)
    world = load_world(load_scene(name))
    return Case(name, world, viewpoints(world, views, seed))


def vehicle_case(*, views: int, seed: int) -> Case:
    """Return views of a swarm of x500s, Irises and racers, each vehicle with a random state in each view.

    The vehicles are within 1 m of a place 20 to 40 m up, the camera is 1 to 2 m from it. Rotors turn at 100 to 1000
    rad/s.
    """
    rng = np.random.Generator(np.random.Philox(seed))
    world = with_vehicles(
        load_world(load_scene("city_park")), {f"{name}_{i}": load_vehicle(name) for i in range(7) for name in _SEEN}
    )
    vehicles = [actor for actor in world.map.actors if isinstance(actor, VehicleBodies)]
    cases = []
    for i in range(views):
        t_ns = i * 10_000_000  # within the second of states that a vehicle keeps
        middle = rng.uniform((-20, -20, 20), (20, 20, 40))
        for vehicle in vehicles:
            w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
            rotors = rng.uniform(100.0, 1000.0, len(vehicle.bodies) - 1)
            vehicle.place_at(
                t_ns,
                _vec3(middle + rng.uniform(-0.3, 0.3, 3)),
                (float(w), float(x), float(y), float(z)),
                _vec3(rng.normal(0.0, 5.0, 3)),
                _vec3(rng.normal(0.0, 3.0, 3)),
                tuple(rotors.tolist()),
            )
        R_WC = looking(rng.uniform(-180, 180), np.rad2deg(np.arcsin(rng.uniform(-1, 1))), roll_deg=rng.uniform(0, 360))
        p_W = middle - rng.uniform(1.0, 2.0) * R_WC[:, 2]
        cases.append(View(t_ns, camera_pose(p_W, R_WC, rng.normal(0.0, 4.0, 3), rng.normal(0.0, 0.5, 3))))
    return Case(VEHICLES, world, tuple(cases))


def viewpoints(world: World, count: int, seed: int) -> tuple[View, ...]:
    """Return `count` viewpoints, a function of world, count and seed. Raises HilError if there are not enough."""
    rng = np.random.Generator(np.random.Philox(seed))
    posed = WorldPose(world)
    low, high = _extent(world.model, posed.data)
    views: list[View] = []
    for _ in range(_TRIES * count):
        if len(views) == count:
            break
        t_ns = int(rng.integers(0, 60_000_000_000))
        height = (
            _MIN_HEIGHT_M + (_MAX_HEIGHT_M - _MIN_HEIGHT_M) * rng.random() ** 2
        )  # squared: low viewpoints show more objects
        p_W = np.array([*rng.uniform(low, high), height])
        third = len(views) % 3
        down_deg = (rng.uniform(-5, 5), rng.uniform(20, 60), rng.uniform(60, 90))[third]
        R_WC = looking(rng.uniform(-180, 180), down_deg, roll_deg=rng.uniform(-5, 5))
        if not _is_clear(world.model, posed.at(t_ns), p_W):
            continue
        v_W, w_W = rng.normal(0.0, 4.0, 3), rng.normal(0.0, 0.5, 3)
        views.append(View(t_ns, camera_pose(p_W, R_WC, v_W, w_W)))
    else:
        raise HilError(
            f"{world.scene.name}: fewer than {count} viewpoints found that are {_CLEAR_M} m from all objects"
        )
    return tuple(views)


def looking(azimuth_deg: float, down_deg: float, *, roll_deg: float = 0.0) -> Float64:
    """Return R_WC of a camera that points along an azimuth (from east, counter-clockwise), `down_deg` below horizon."""
    a, e, r = np.deg2rad([azimuth_deg, down_deg, roll_deg])
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    level_right = np.array([np.sin(a), -np.cos(a), 0.0])
    level_down = np.cross(forward, level_right)
    right = np.cos(r) * level_right + np.sin(r) * level_down
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def camera_pose(
    p_W: Float64, R_WC: Float64, v_W: Sequence[float] | Float64 = (0, 0, 0), w_W: Sequence[float] | Float64 = (0, 0, 0)
) -> CameraPose:
    """Return the CameraPose for a position [m], attitude (3, 3), velocity [m/s] and angular velocity [rad/s]."""
    a, b, c, d, e, f, g, h, i = np.asarray(R_WC, np.float64).ravel().tolist()
    return CameraPose(_vec3(p_W), (a, b, c, d, e, f, g, h, i), _vec3(v_W), _vec3(w_W))


def _vec3(values: Sequence[float] | Float64) -> Vec3:
    x, y, z = values
    return float(x), float(y), float(z)


def world_of(mjcf: str) -> World:
    """Return the World of an MJCF text, loaded like a user's file."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "field.xml").write_text(mjcf)
        scene = Path(folder, "field.yaml")
        scene.write_text(_FIELD_SCENE)
        return load_world(load_scene(str(scene)))


def world_with(geoms: Sequence[str]) -> World:
    """Return a World of the given MJCF geoms over a sunlit plane."""
    return world_of(
        '<mujoco><default><geom contype="0" conaffinity="0"/></default><worldbody>'
        '<light directional="true" dir="-0.4 0.3 -0.9" castshadow="true"/>'
        f'<geom name="ground" type="plane" size="0 0 1"/>{"".join(geoms)}</worldbody></mujoco>'
    )


def field_case(count: int, *, seed: int, views: int) -> Case:
    """Return a field of `count` random primitives on 80 x 80 m, seen from its edge."""
    rng = np.random.Generator(np.random.Philox(seed))
    geoms = random_geoms(rng, count, (-40, -40, 0.5), (40, 40, 12))
    poses = []
    for i in range(views):
        azimuth = 360.0 * i / views
        p_W = -50.0 * np.array([np.cos(np.deg2rad(azimuth)), np.sin(np.deg2rad(azimuth)), 0.0]) + [0, 0, 8.0]
        poses.append(View(i * 100_000_000, camera_pose(p_W, looking(azimuth, 10.0))))
    return Case(f"field of {count}", world_with(geoms), tuple(poses))


def hidden_case(visible: int, hidden: int, *, where: str, seed: int) -> Case:
    """Return `visible` geoms in front of a camera, one of them a wall, and `hidden` geoms that it does not see.

    `where`: the place of the hidden geoms, "behind a wall" or "out of view".
    """
    rng = np.random.Generator(np.random.Philox(seed))
    geoms = random_geoms(rng, visible - 1, (4, -8, 0.5), (24, 8, 10))
    geoms.append('<geom type="box" size="0.5 60 40" pos="30 0 30"/>')
    behind_wall, behind_camera = ((32, -50, 1), (100, 50, 50)), ((-100, -50, 1), (-5, 50, 50))
    geoms += random_geoms(rng, hidden, *(behind_wall if where == "behind a wall" else behind_camera))
    view = View(0, camera_pose(np.array([0.0, 0.0, 5.0]), looking(0.0, 0.0)))
    name = f"{visible} visible" + (f", {hidden} {where}" if hidden else "")
    return Case(name, world_with(geoms), (view,))


def random_geoms(
    rng: np.random.Generator, count: int, low: Sequence[float], high: Sequence[float], *, largest_m: float = 0.6
) -> list[str]:
    """Return MJCF texts of random primitives of all kinds between the corners `low` and `high` [m]."""
    kinds = (("sphere", 1), ("box", 3), ("capsule", 2), ("cylinder", 2), ("ellipsoid", 3))
    geoms = []
    for i in range(count):
        kind, sizes = kinds[i % len(kinds)]
        size, position = rng.uniform(0.1, largest_m, sizes), rng.uniform(low, high)
        quaternion, colour = rng.normal(size=4), [*rng.uniform(0.2, 1.0, 3), 1.0]
        geoms.append(
            f'<geom type="{kind}" size="{_text(size)}" pos="{_text(position)}" quat="{_text(quaternion)}" '
            f'rgba="{_text(colour)}"/>'
        )
    return geoms


def _text(values: Sequence[float] | Float64) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _extent(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Float64, Float64]:
    """Return the lower and upper corner, in x and y [m], of the middle 90 % of the objects' centres."""
    bounded = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_group < 3)
    centres = data.geom_xpos[bounded][:, :2] if bounded.any() else np.array([[-20.0, -20.0], [20.0, 20.0]])
    low, high = np.quantile(centres, 0.05, axis=0), np.quantile(centres, 0.95, axis=0)
    return np.minimum(low, -5.0), np.maximum(high, 5.0)


def _is_clear(model: mujoco.MjModel, data: mujoco.MjData, p_W: Float64) -> bool:
    """Return True if p_W is at least half a metre from all geoms and not inside a closed one."""
    i = np.arange(256) + 0.5
    z, azimuth = 1.0 - i / 128.0, i * 2.399963229728653  # directions spread evenly, by the golden angle
    r = np.sqrt(1.0 - z * z)
    rays = np.ascontiguousarray(np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1))
    geom, distance, normal = cast(model, data, p_W, rays)
    hit = geom >= 0
    if hit.any() and distance[hit].min() < _CLEAR_M:
        return False
    # Inside a closed shape, rays hit the backs of its faces, where mj_ray's normals point along the ray. Meshes may be
    # open, so they do not count.
    back_face = np.einsum("ij,ij->i", normal, rays) > 1e-9
    solid = model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH
    return not bool((hit & back_face & solid).any())
