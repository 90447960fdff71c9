"""A skipping rule leaves out work that cannot affect the outputs: each one alone, on and off, gives the same bits.

Only the rule for the backs of meshes may change a small share of the values.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from hil.apps.bench_suite.sensors.raster_cases import (
    Case,
    View,
    camera_pose,
    field_case,
    looking,
    scene_case,
    world_of,
)
from lab.skip import Rule, compare, contact_rule, lidar_rules, radar_rule, raster_rules
from signals.samples import TruthState
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import Execution, FrameRenderer, RenderSkips

CAMERA = CameraModel.from_fov(92, 66, 90.0)  # not whole blocks of 4 x 4


@pytest.fixture(scope="module")
def park() -> Case:
    return scene_case("city_park", views=2, seed=3)


def test_pictures_are_the_same_with_and_without_each_rule(park: Case) -> None:
    rules = raster_rules(park, CAMERA)
    assert len(rules) == len(fields(RenderSkips)) + 1  # the rule for unused channels is not a field
    shares = {rule.name: compare(rule, rounds=1)[1] for rule in rules}
    assert {rule.name: shares[rule.name] for rule in rules if shares[rule.name] > rule.may_differ} == {}
    assert {rule.name for rule in rules if rule.may_differ > 0.0} == {"mesh backs"}


def test_pictures_of_many_geoms_are_the_same_with_and_without_each_rule() -> None:
    rules = raster_rules(field_case(800, seed=2, views=3), CAMERA)
    shares = {rule.name: compare(rule, rounds=1)[1] for rule in rules}
    assert {rule.name: shares[rule.name] for rule in rules if shares[rule.name] > rule.may_differ} == {}
    assert {rule.name for rule in rules if rule.may_differ > 0.0} == {"mesh backs"}


def test_the_flight_of_the_contact_rule_lands_again_and_all_of_its_state_is_compared() -> None:
    rule = contact_rule(4.0)
    ((_, flight),) = list(rule.run(True))
    assert set(flight) == set(TruthState._fields)
    assert {len(values) for values in flight.values()} == {1000}
    touches = flight["in_contact"]
    airborne = np.flatnonzero(~touches)
    assert touches[0]
    assert flight["p_WB"][airborne, 2].max() > 0.7
    assert touches[airborne[0] :].sum() > 100
    assert touches[-1]
    assert compare(rule, rounds=1)[1] == 0.0


def test_rays_are_the_same_with_and_without_each_rule(park: Case) -> None:
    rules = lidar_rules(replace(park, views=park.views[:1]))
    assert len(rules) == 2
    for rule in rules:
        assert compare(rule, rounds=1)[1] == 0.0
        _, found = next(rule.run(True))
        met = found["range"][found["geom"] >= 0]
        assert len(met) > 1000
        assert met.max() <= 50.0


def test_raw_frames_are_the_same_whether_or_not_the_rest_is_made(park: Case) -> None:
    rule = radar_rule(park)
    assert compare(rule, rounds=1)[1] == 0.0
    frames = [found["raw"] for _, found in rule.run(True)]
    assert len(frames) == len(park.views)
    assert frames[0].shape == (3, 64, 64)
    assert not np.array_equal(frames[0], frames[1])


@pytest.mark.parametrize("shape", [(0,), (3, 0), (2, 2)])
def test_arrays_are_compared_bit_for_bit_also_without_values(shape: tuple[int, ...]) -> None:
    rule = Rule("none", "empty", lambda on: iter([(1.0, {"zeros": np.full(shape, 0.0 if on else -0.0)})]))
    assert compare(rule, rounds=1)[1] == (0.0 if 0 in shape else 1.0)


def _fine_meshes() -> Case:
    """Return blades of long, thin triangles at many angles, and balls of triangles much smaller than a pixel."""
    rng = np.random.Generator(np.random.Philox(5))
    hubs = rng.uniform((8, -10, 1), (30, 10, 8), (30, 3))
    ends = hubs[:, None, :] + rng.normal(0.0, 1.0, (30, 2, 3)) * (6.0, 6.0, 3.0)
    blades = np.concatenate([hubs[:, None, :], ends[:, :1], ends[:, :1] + 0.05 * (ends[:, 1:] - ends[:, :1])], axis=1)
    z, azimuth = np.meshgrid(np.linspace(-1, 1, 14), np.linspace(0, 2 * np.pi, 20, endpoint=False), indexing="ij")
    r = np.sqrt(1.0 - z**2)
    ball = 0.4 * np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1)
    i, j = np.meshgrid(np.arange(13), np.arange(20), indexing="ij")
    a, b = (20 * i + j).ravel(), (20 * i + (j + 1) % 20).ravel()
    faces = np.concatenate([np.stack([a, b, b + 20], axis=1), np.stack([a, b + 20, a + 20], axis=1)])
    balls = "".join(
        f'<geom type="mesh" mesh="ball" pos="{x:.3f} {y:.3f} {z:.3f}"/>'
        for x, y, z in rng.uniform((5, -60, 0.5), (120, 60, 20), (80, 3))
    )
    world = world_of(
        '<mujoco><default><geom contype="0" conaffinity="0"/></default><asset>'
        f'<mesh name="ball" inertia="shell" vertex="{_numbers(ball)}" face="{_numbers(faces)}"/>'
        f'<mesh name="blades" inertia="shell" vertex="{_numbers(blades)}" face="{_numbers(np.arange(90))}"/>'
        '</asset><worldbody><geom type="plane" size="0 0 1"/><geom type="mesh" mesh="blades"/>'
        f"{balls}</worldbody></mujoco>"
    )
    poses = (
        camera_pose(np.array([0.0, 0.0, h]), looking(0.0, down, roll_deg=roll))
        for h, down, roll in ((2.0, 0.0, 0.0), (5.0, 10.0, 30.0), (25.0, 40.0, -75.0))
    )
    return Case("fine meshes", world, tuple(View(0, pose) for pose in poses))


def _numbers(values: NDArray) -> str:
    return " ".join(f"{value:.6g}" for value in np.ravel(values))


def test_slivers_and_triangles_smaller_than_pixels_are_the_same_without_skipping_and_as_mj_ray_finds_them() -> None:
    case = _fine_meshes()
    geometry = FrameGeometry(case.world)
    camera = CameraModel.from_fov(320, 240, 90.0)
    everything = RenderSkips(frustum=False, occlusion=False)
    for view in case.views:
        pictures = []
        for execution in (Execution(), Execution(threads=3), Execution(skips=everything), Execution(isa="base")):
            renderer = FrameRenderer(geometry, camera, execution=execution)
            pictures.append(renderer.buffers("rgb", "depth", "geom"))
            renderer.render(view.pose, pictures[-1])
        for picture in pictures[1:]:
            assert {name: np.array_equal(pictures[0][name], picture[name]) for name in picture} == dict.fromkeys(
                picture, True
            )
        rays = np.ascontiguousarray(camera.rays().reshape(-1, 3) @ np.reshape(view.pose.R_WC, (3, 3)).T)
        posed = WorldPose(case.world)
        geom, _, _ = cast(posed.model, posed.at(0), np.array(view.pose.p_WC), rays)
        seen = pictures[0]["geom"].ravel()
        of_meshes = (seen > 0) | (geom > 0)
        assert of_meshes.sum() > 1000
        assert (seen != geom)[of_meshes].sum() <= 2


def test_long_boxes_and_triangles_around_the_camera_are_the_same_without_skipping() -> None:
    """Boxes and triangles that reach from before the camera to behind it, at random attitudes."""
    rng = np.random.Generator(np.random.Philox(8))
    middles = rng.uniform((-4, -4, 0.5), (4, 4, 6), (60, 3))
    boxes = [
        f'<geom type="box" size="{_numbers(rng.uniform((4, 0.02, 0.005), (40, 0.6, 0.3)))}" pos="{_numbers(middle)}" '
        f'quat="{_numbers(rng.normal(size=4))}"/>'
        for middle in middles[:40]
    ]
    corners = middles[40:, None, :] + rng.normal(0.0, 20.0, (20, 3, 3))
    world = world_of(
        '<mujoco><default><geom contype="0" conaffinity="0"/></default><asset>'
        f'<mesh name="sheets" inertia="shell" vertex="{_numbers(corners)}" face="{_numbers(np.arange(60))}"/>'
        f'</asset><worldbody><geom type="mesh" mesh="sheets"/>{"".join(boxes)}</worldbody></mujoco>'
    )
    geometry = FrameGeometry(world)
    camera = CameraModel.from_fov(320, 240, 90.0)
    seen: set[int] = set()
    for i in range(12):
        attitude = looking(30.0 * i, rng.uniform(-60, 60), roll_deg=rng.uniform(0, 360))
        pose = camera_pose(rng.uniform((-3, -3, 1), (3, 3, 5)), attitude)
        pictures = []
        for skips in (RenderSkips(mesh_backs=False), RenderSkips.none()):
            renderer = FrameRenderer(geometry, camera, execution=Execution(skips=skips))
            pictures.append(renderer.buffers("rgb", "depth", "geom", "normal"))
            renderer.render(pose, pictures[-1])
        for name, values in pictures[0].items():
            assert np.array_equal(values, pictures[1][name]), f"view {i}: {name}"
        seen.update(np.unique(pictures[0]["geom"]).tolist())
    assert len(seen) > 35
