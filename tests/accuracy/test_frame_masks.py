"""Meshes with holes (leaf cards): raster and ray caster against the texel under each ray, and the shadow's share."""

from __future__ import annotations

from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from hil.apps.bench_suite.sensors.raster_cases import camera_pose
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import Execution, FrameRenderer
from sim.scene.scene import Scene, load_scene
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import ISAS

SIDE_PX = 32
# A quad of 2 x 2 m at x = 4 m that faces -x, its texture laid twice across; the back wall is at x = 6 m.
SCENE = """\
name: card
description: a card with holes before a wall
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
light: {sun_elevation_deg: 90.0, sun_azimuth_deg: 0.0}
map: {mjcf: map.xml}
"""
CARD = "v 0 -1 0\nv 0 1 0\nv 0 1 2\nv 0 -1 2\nvt 0 0\nvt 2 0\nvt 2 1\nvt 0 1\nf 1/1 3/3 2/2\nf 1/1 4/4 3/3\n"
MAP = (
    '<mujoco><asset><texture name="holes" type="2d" file="holes.png" nchannel="4"/>'
    '<material name="leaf" texture="holes" specular="0"/><mesh name="card" file="card.obj" inertia="shell"/></asset>'
    '<worldbody><geom name="ground" type="plane" size="20 20 1"/>'
    '<geom name="wall" type="box" size="0.1 9 9" pos="6.1 0 0"/>'
    '<geom name="card" type="mesh" mesh="card" {pose} material="leaf" contype="0" conaffinity="0"/>'
    "</worldbody></mujoco>"
)
LENSES = {
    "pinhole": CameraModel.from_fov(160, 120, 60.0),
    "fisheye": CameraModel.from_fov(160, 120, 60.0, KannalaBrandt(0.01, 0.0, 0.0, 0.0)),
}


def opaque_texels() -> NDArray[np.bool_]:
    return np.random.default_rng(4).random((SIDE_PX, SIDE_PX)) < 0.4


def scene_with_card(folder: Path, pose: str) -> Scene:
    rgba = np.full((SIDE_PX, SIDE_PX, 4), 255, np.uint8)
    rgba[:, :, 3] = 255 * opaque_texels()
    cv2.imwrite(str(folder / "holes.png"), rgba)
    (folder / "card.obj").write_text(CARD)
    (folder / "map.xml").write_text(MAP.format(pose=pose))
    (folder / "scene.yaml").write_text(SCENE)
    return load_scene(folder / "scene.yaml")


@pytest.fixture
def geometry(tmp_path: Path) -> FrameGeometry:
    return FrameGeometry(load_world(scene_with_card(tmp_path, 'pos="4 0 0"')))


def expected(origin_W: NDArray[np.float64], d_W: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether each ray meets an opaque texel of the card, and whether it passes 1e-3 texels clear of an edge."""
    at = origin_W + ((4.0 - origin_W[0]) / d_W[..., :1]) * d_W
    u, v = (at[..., 1] + 1.0) * SIDE_PX, at[..., 2] * 0.5 * SIDE_PX  # in texels: the texture is laid twice along y
    on_card = (abs(at[..., 1]) < 1.0) & (at[..., 2] > 0.0) & (at[..., 2] < 2.0) & (d_W[..., 0] > 0.0)
    column = np.floor(u).astype(int) % SIDE_PX
    row = SIDE_PX - 1 - np.floor(v).astype(int) % SIDE_PX
    clear = (abs(u - np.round(u)) > 1e-3) & (abs(v - np.round(v)) > 1e-3)
    return on_card & opaque_texels()[row, column], clear


def rays(model: CameraModel, R_WC: NDArray[np.float64]) -> NDArray[np.float64]:
    columns, rows = np.meshgrid(np.arange(model.width) + 0.5, np.arange(model.height) + 0.5)
    points = np.stack([(columns - model.cx) / model.fx, (rows - model.cy) / model.fy], axis=-1)
    return np.asarray(model.directions(points.reshape(-1, 2))).reshape(*columns.shape, 3) @ R_WC.T


@pytest.mark.parametrize("isa", ISAS)
@pytest.mark.parametrize("lens", LENSES)
def test_a_pixel_sees_the_card_where_its_texel_is_opaque(geometry: FrameGeometry, lens: str, isa: str) -> None:
    model = LENSES[lens]
    renderer = FrameRenderer(geometry, model, execution=Execution(isa=isa))
    card = geometry.world.model.geom("card").id
    R_WC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # looks along +x
    for p in ([0.0, 0.0, 1.0], [1.5, 1.2, 0.6], [3.4, -0.2, 1.1]):
        out = renderer.buffers("geom", "depth")
        renderer.render(camera_pose(np.array(p), R_WC), out)
        hit, clear = expected(np.array(p), rays(model, R_WC))
        assert 0.05 < hit.mean() < 0.5
        assert np.array_equal(out["geom"][clear] == card, hit[clear])
        assert abs(out["depth"][clear & hit] - (4.0 - p[0])).max() < 1e-5


@pytest.mark.parametrize("isa", ISAS)
@pytest.mark.parametrize("bundle", [1, 8, 64])
def test_a_ray_meets_the_card_where_its_texel_is_opaque(geometry: FrameGeometry, isa: str, bundle: int) -> None:
    rng = np.random.default_rng(bundle)
    card = geometry.world.model.geom("card").id
    direction = np.array([1.0, 0.0, 0.0]) + np.repeat(rng.uniform(-0.4, 0.4, (4096 // bundle, 3)), bundle, axis=0)
    direction += 0.02 * rng.uniform(-1.0, 1.0, direction.shape)
    origin = np.array([0.5, 0.1, 1.1])
    ranges, geoms = np.empty(len(direction)), np.empty(len(direction), np.int32)
    for tree in (True, False):
        geometry.caster.cast(origin[None], direction, 0.0, 100.0, ranges, geoms, isa=isa, tree=tree)
        hit, clear = expected(origin, direction)
        assert 0.1 < hit.mean() < 0.5
        assert np.array_equal(geoms[clear] == card, hit[clear])


def test_rays_of_mujoco_go_on_through_holes(geometry: FrameGeometry) -> None:
    """The reference of the benches, against the plain formula."""
    model = geometry.world.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    direction = np.random.default_rng(9).uniform((0.9, -0.3, -0.3), (1.0, 0.3, 0.3), (500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = np.array([0.5, 0.1, 1.1])
    geom, range_m, _ = cast(model, data, origin, direction)
    hit, clear = expected(origin, direction)
    assert np.array_equal(geom[clear] == model.geom("card").id, hit[clear])
    behind = clear & ~hit & (geom == model.geom("wall").id)
    assert abs(range_m * direction[:, 0] - 5.5)[behind].max() < 1e-9
    assert behind.sum() > 100


def test_the_shadow_of_leaves_has_their_share_of_opaque_texels(tmp_path: Path) -> None:
    # The card lies flat 3 m above the ground, under a sun at the zenith.
    lying = 'pos="5 0 3" quat="0.70710678 0 -0.70710678 0"'
    geometry = FrameGeometry(load_world(scene_with_card(tmp_path, lying)))
    looking_down = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    pose = camera_pose(np.array([4.0, 0.0, 2.0]), looking_down)
    means = []
    for shadows in (False, True):
        renderer = FrameRenderer(geometry, CameraModel.from_fov(96, 96, 30.0), shadows=shadows)
        out = renderer.buffers("rgb")
        renderer.render(pose, out)
        means.append((out["rgb"] / 255.0) ** 2.2)
    lit, shaded = means[0].mean(), means[1]
    dark = shaded.min()
    share = (lit - shaded.mean()) / (lit - dark)
    assert share == pytest.approx(opaque_texels().mean(), abs=0.06)
