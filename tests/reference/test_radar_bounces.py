"""Ghosts of small scenes against exact paths: range within 1 cm, speed within 0.01 m/s, power within 0.5 dB.

The paths are enumerated by images of the scene's planes over dense points of its surfaces, with MuJoCo's visibility
(tests/worlds/radar_paths.py).
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from signals.samples import Vec3
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.radar.antenna import Antenna, Pattern
from sim.radar.bounces import Bounces
from sim.radar.ghost_echoes import KINDS, GhostEchoes, Ghosts
from sim.radar.mask import Mask
from sim.radar.scatterers import amplitude_scale
from sim.scene.scene import Scene, load_scene
from sim.scene.scene_map import CornerReflector, Surface
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.radar_paths import Patch, PathTracer, Plane, Sum, face, gamma2, sphere
from tests.worlds.radar_point_targets import CHIRP
from tests.worlds.radar_scenes import EASTWARDS, RECEIVER

ROUGH = Surface(0.5, 1.0, 1e8, 0.05)  # so rough that nothing stays coherent
CONCRETE = Surface(0.35, 5.24, 1.14, 3e-4)
METAL = Surface(0.5, 1.0, 1e7, 2e-6)
SURFACES = {"rough": ROUGH, "concrete": CONCRETE, "metal": METAL}
ANTENNA = Antenna(
    rx_positions_m=((0.0, 0.0, 0.0),),
    tx=Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=85.0, elevation_beamwidth_deg=60.0),
    rx=Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=100.0, elevation_beamwidth_deg=80.0),
)
PLACE: Vec3 = (0.0, 0.0, 1.8)
MOVING: Vec3 = (1.3, -0.4, 0.3)

GROUND = '<geom name="ground" type="plane" size="0 0 1" material="concrete"/>'
WALL = '<geom name="wall" type="box" size="6 .1 3" pos="4 2.1 2" material="metal"/>'
BALL = '<body name="ball" pos="5 -.6 1.1"><geom name="ball" size=".4" material="rough"/></body>'
POST = '<body name="post" pos="2.6 -.05 .5"><geom name="post" type="box" size=".05 .25 .5" material="rough"/></body>'
BOX = '<body name="crate" pos="4.5 -.8 1"><geom name="crate" type="box" size=".3 .3 .5" material="rough"/></body>'


def world_of(folder: Path, *geoms: str) -> World:
    materials = "".join(f'<material name="{name}"/>' for name in SURFACES)
    path = folder / "scene.xml"
    path.write_text(f"<mujoco><asset>{materials}</asset><worldbody>{''.join(geoms)}</worldbody></mujoco>")
    names = ("lidar_reflectivity", "relative_permittivity", "conductivity_s_per_m", "roughness_m")
    surfaces = {k: {n: getattr(s, n) for n in names} for k, s in SURFACES.items()}
    section: dict[str, Any] = {"mjcf": str(path), "surfaces": surfaces}
    plain = load_scene("airfield").model_dump()
    return load_world(Scene.model_validate(plain | {"name": "scene", "map": section}))


def ghosts_of(world: World, **settings: float) -> Ghosts:
    finder = GhostEchoes(FrameGeometry(world), CHIRP, ANTENNA, RECEIVER, Mask(max_range_m=30.0), Bounces(**settings))
    return finder.find(CameraPose(PLACE, EASTWARDS, MOVING))


def sum_of(world: World, ghosts: Ghosts, kind: str, target: str, mirror: str) -> Sum:
    """Return the ghosts of one object by one mirror."""
    geom = {name: mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in (target, mirror)}
    some = ghosts.kind == KINDS.index(kind)
    some &= ghosts.instance == int(world.geom_instance[geom[target]])
    some &= ghosts.mirror == int(world.geom_instance[geom[mirror]])
    e = ghosts.echoes
    power = e.amplitude[some] ** 2
    total = float(power.sum())
    if total == 0.0:
        return Sum(0.0, math.nan, math.nan)
    return Sum(total, float((power * e.range_m[some]).sum()) / total, float((power * e.speed_mps[some]).sum()) / total)


def tracer_of(world: World) -> PathTracer:
    scale = amplitude_scale(CHIRP, ANTENNA, RECEIVER)
    return PathTracer(world.model, ANTENNA, scale, CHIRP.center_frequency_hz, np.array(PLACE), np.array(MOVING))


def plane_of(world: World, name: str, point: Vec3, normal: Vec3, surface: Surface) -> Plane:
    geom = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_GEOM, name)
    return Plane(geom, np.array(point), np.array(normal), surface)


def crate() -> list[Patch]:
    x, y, z = (4.5, -0.8, 1.0)
    return [
        face((x - 0.3, y, z), (0, 0, 0.5), (0, 0.3, 0), (30, 18), ROUGH),
        face((x, y + 0.3, z), (0, 0, 0.5), (0.3, 0, 0), (30, 18), ROUGH),
        face((x, y - 0.3, z), (0.3, 0, 0), (0, 0, 0.5), (18, 30), ROUGH),
        face((x, y, z + 0.5), (0.3, 0, 0), (0, 0.3, 0), (18, 18), ROUGH),
        face((x, y, z - 0.5), (0, 0.3, 0), (0.3, 0, 0), (18, 18), ROUGH),
    ]


def ball() -> list[Patch]:
    return [sphere((5.0, -0.6, 1.1), 0.4, 3000, ROUGH)]


def exact(world: World, patches: list[Patch], plane: Plane) -> dict[str, Sum]:
    made = [tracer_of(world).sums(patch, plane) for patch in patches]
    sums = {}
    for kind in KINDS[1:]:
        parts = [m[kind] for m in made if m[kind].power > 0.0]
        total = sum(p.power for p in parts)
        means = (
            sum(p.power * value for p, value in zip(parts, values, strict=True)) / total
            for values in ([p.range_m for p in parts], [p.speed_mps for p in parts])
        )
        sums[kind] = Sum(total, *means)
    return sums


def check(found: Sum, true: Sum) -> None:
    assert abs(10.0 * math.log10(found.power / true.power)) < 0.5
    assert abs(found.range_m - true.range_m) < 0.01
    assert abs(found.speed_mps - true.speed_mps) < 0.01


SCENES = {
    "ball over ground": ((GROUND, BALL), ball, "ball", "ground"),
    "ball half behind a post": ((GROUND, POST, BALL), ball, "ball", "ground"),
    "crate beside a wall": ((WALL, BOX), crate, "crate", "wall"),
    "crate over ground": ((GROUND, WALL, BOX), crate, "crate", "ground"),
}
PLANES: dict[str, tuple[Vec3, Vec3, Surface]] = {
    "ground": ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), CONCRETE),
    "wall": ((4.0, 2.0, 2.0), (0.0, -1.0, 0.0), METAL),
}


@pytest.mark.parametrize("name", SCENES)
def test_ghosts_are_those_of_exact_paths(tmp_path: Path, name: str) -> None:
    geoms, patches, target, mirror = SCENES[name]
    world = world_of(tmp_path, *geoms)
    true, ghosts = exact(world, patches(), plane_of(world, mirror, *PLANES[mirror])), ghosts_of(world)
    for kind in KINDS[1:]:
        check(sum_of(world, ghosts, kind, target, mirror), true[kind])


@pytest.mark.parametrize(("target", "mirror"), [("wall", "ground"), ("ground", "wall")])
def test_two_surfaces_that_face_each_other(tmp_path: Path, target: str, mirror: str) -> None:
    wall = '<geom name="wall" type="box" size=".1 2 2" pos="5.1 0 2" material="concrete"/>'
    ground = '<geom name="ground" type="box" size="4 3 .1" pos="3 0 -.1" material="concrete"/>'
    world = world_of(tmp_path, wall, ground)
    planes = {
        "wall": plane_of(world, "wall", (5.0, 0.0, 2.0), (-1.0, 0.0, 0.0), CONCRETE),
        "ground": plane_of(world, "ground", (3.0, 0.0, 0.0), (0.0, 0.0, 1.0), CONCRETE),
    }
    patches = {
        "wall": [face((5.0, 0.0, 2.0), (0, 0, 2.0), (0, 2.0, 0), (90, 90), CONCRETE)],
        "ground": [face((3.0, 0.0, 0.0), (4.0, 0, 0), (0, 3.0, 0), (120, 90), CONCRETE)],
    }
    true, ghosts = exact(world, patches[target], planes[mirror]), ghosts_of(world)
    for kind in KINDS[1:]:
        check(sum_of(world, ghosts, kind, target, mirror), true[kind])


def test_the_corner_in_the_ground(tmp_path: Path) -> None:
    """A corner's image by the ground has the range, direction, speed and cross-section of one seen from below."""
    corner_W, edge_m = np.array([6.0, 0.8, 1.2]), 0.25
    third = math.sqrt(1.0 / 3.0)
    aim = np.array([-6.0, -0.8, -3.0]) / np.linalg.norm([6.0, 0.8, 3.0])  # at the radar's image
    q = np.array([1.0 + third * aim.sum(), *(third * np.array([aim[2] - aim[1], aim[0] - aim[2], aim[1] - aim[0]]))])
    q /= np.linalg.norm(q)
    x, y, z = corner_W.tolist()
    corner = CornerReflector((x, y, z), tuple(q.tolist()), edge_m, "object")  # type: ignore[arg-type]
    world = world_of(tmp_path, GROUND)
    world = dataclasses.replace(world, map=dataclasses.replace(world.map, corners=(corner,)))
    ghosts = ghosts_of(world, floor_db=-60.0)
    assert ghosts.count == 1
    e = ghosts.echoes
    image = np.array([0.0, 0.0, -1.8])
    beyond = corner_W - image
    range_m = float(np.linalg.norm(beyond))
    u = beyond / range_m
    d = u * np.array([1.0, 1.0, -1.0])  # out by the ground
    section = 12.0 * math.pi * edge_m**4 / CHIRP.wavelength_m**2
    h = 4.0 * math.pi * CONCRETE.roughness_m / CHIRP.wavelength_m * u[2]
    g2 = gamma2(CONCRETE, CHIRP.center_frequency_hz, u[2]) * math.exp(-(h**2))
    share = float(ANTENNA.share(d[None])[0])
    scale = amplitude_scale(CHIRP, ANTENNA, RECEIVER)
    amplitude = scale * math.sqrt(share * section) * g2 / range_m**2
    assert e.range_m[0] == pytest.approx(range_m, abs=1e-6)
    assert e.speed_mps[0] == pytest.approx(-float(np.dot(MOVING, d)), abs=1e-9)
    assert np.allclose(e.direction_R[0], d, atol=1e-9)
    assert e.amplitude[0] == pytest.approx(amplitude, rel=1e-3)


def test_speeds_are_the_rates_of_the_paths(tmp_path: Path) -> None:
    """Between two places of the radar, mean ranges change by the mean speed; each ghost is found in both."""
    world = world_of(tmp_path, GROUND, WALL, BALL)
    step_s = 0.05
    finder = GhostEchoes(FrameGeometry(world), CHIRP, ANTENNA, RECEIVER, Mask(max_range_m=30.0), Bounces())
    sums = []
    for t in (-step_s, 0.0, step_s):
        place = tuple(p + v * t for p, v in zip(PLACE, MOVING, strict=True))
        sums.append(finder.find(CameraPose(place, EASTWARDS, MOVING)))  # type: ignore[arg-type]
    for kind in KINDS[1:]:
        before, now, after = (sum_of(world, ghosts, kind, "ball", "ground") for ghosts in sums)
        assert (after.range_m - before.range_m) / (2.0 * step_s) == pytest.approx(now.speed_mps, abs=0.03)


def test_a_rough_ground_has_no_ghosts(tmp_path: Path) -> None:
    assert ghosts_of(world_of(tmp_path, GROUND.replace("concrete", "rough"), BALL)).count == 0


def test_a_ball_is_no_mirror(tmp_path: Path) -> None:
    mirror = '<body pos="3 1.5 1"><geom name="mirror" size=".8" material="metal"/></body>'
    assert ghosts_of(world_of(tmp_path, mirror, BALL)).count == 0


def test_ghosts_below_the_floor_are_left_out(tmp_path: Path) -> None:
    """A higher floor leaves out weaker mirrors."""
    world = world_of(tmp_path, GROUND, BALL)
    low, high = (ghosts_of(world, floor_db=floor) for floor in (-60.0, -10.0))
    assert 0 < high.count < low.count
