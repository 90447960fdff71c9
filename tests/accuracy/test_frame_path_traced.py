"""Path-traced colour: its geometry against the raster's, its light against closed forms (extra `photo`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import Case, View, camera_pose, looking, scene_case
from signals.samples import ImageSample, TruthState
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady, KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.renderer import PathTracedRenderer, PathTracer, tracer_of
from sim.frame.path_traced.sky_request import sky_request
from sim.frame.path_traced.tone import to_srgb
from sim.frame.renderer import FrameRenderer
from sim.frame.source import SharedFrames, channel_array
from sim.scene.light import Light
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from sim.world_loader import load_world
from tests.accuracy.test_frame_masks import scene_with_card

LENSES = {
    "pinhole": CameraModel.from_fov(160, 120, 90.0),
    "off-centre": replace(CameraModel.from_fov(160, 120, 70.0), cx=50.0, cy=71.0),
    "brown_conrady": CameraModel.from_fov(160, 120, 70.0, BrownConrady(-0.2, 0.05, 1e-3, -2e-3, 0.0)),
    "fisheye": CameraModel.from_fov(160, 120, 170.0, KannalaBrandt(0.01, -0.002, 0.0, 0.0)),
}


def tracer_or_skip(geometry: FrameGeometry) -> PathTracer:
    try:
        return tracer_of(geometry)
    except PathTracerError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def park() -> Case:
    return scene_case("city_park", views=3, seed=5)


@pytest.fixture(scope="module")
def geometry(park: Case) -> Iterator[FrameGeometry]:
    geometry = FrameGeometry(park.world)
    tracer = tracer_or_skip(geometry)
    tracer.users += 1  # keeps the process for all tests of this file
    yield geometry
    tracer.close()


def raster(geometry: FrameGeometry, view: Any, camera: CameraModel) -> dict[str, Any]:
    renderer = FrameRenderer(geometry, camera)
    out = renderer.buffers("geom", "range")
    geometry.expect(view.t_ns)
    renderer.render(view.pose, out)
    return out


@pytest.mark.parametrize("lens", LENSES)
def test_silhouettes_are_within_a_tenth_of_a_pixel_and_depths_within_a_millimetre(
    park: Case, geometry: FrameGeometry, lens: str
) -> None:
    camera, tracer = LENSES[lens], tracer_of(geometry)
    number = tracer.add_camera(camera, (0.05, 10_000.0))
    errors_m = []
    for view in park.views:
        geom, range_m = tracer.surfaces(number, view.pose, view.t_ns)
        own = raster(geometry, view, camera)
        near = geom == own["geom"]
        for x, y in ((-0.1, 0), (0.1, 0), (0, -0.1), (0, 0.1)):
            shifted = replace(camera, cx=camera.cx + x, cy=camera.cy + y)
            near |= geom == raster(geometry, view, shifted)["geom"]
        assert near.mean() > 0.9999
        same = (geom == own["geom"]) & (geom >= 0) & (own["range"] < 60.0)
        errors_m.append(np.abs(range_m - own["range"])[same])
    assert np.concatenate(errors_m).size > 2000
    assert np.quantile(np.concatenate(errors_m), 0.99) < 1e-3


def test_a_picture_is_the_same_again_and_its_edges_are_the_rasters(park: Case, geometry: FrameGeometry) -> None:
    camera = LENSES["pinhole"]
    renderer = PathTracedRenderer(FrameRenderer(geometry, camera), tracer_of(geometry), samples=8)
    native = FrameRenderer(geometry, camera, shadows=True)
    pictures = []
    for view in (park.views[0], park.views[1], park.views[0]):
        geometry.expect(view.t_ns)
        traced, drawn = channel_array("rgb", camera), channel_array("rgb", camera)
        renderer.render(view.pose, {"rgb": traced})
        native.render(view.pose, {"rgb": drawn})
        pictures.append(traced)
        # The light differs, but textures and edges are the same.
        assert np.corrcoef(traced.mean(axis=2).ravel(), drawn.mean(axis=2).ravel())[0, 1] > 0.75
    renderer.close()
    assert np.array_equal(pictures[0], pictures[2])
    assert not np.array_equal(pictures[0], pictures[1])


def test_holes_of_a_mesh_are_the_rasters(tmp_path: Path) -> None:
    geometry = FrameGeometry(load_world(scene_with_card(tmp_path, 'pos="4 0 0"')))
    tracer = tracer_or_skip(geometry)
    view = View(0, camera_pose(np.array([1.5, 0.3, 0.9]), looking(0.0, 0.0)))
    camera = LENSES["pinhole"]
    geom, range_m = tracer.surfaces(tracer.add_camera(camera, (0.05, 100.0)), view.pose, 0)
    own = raster(geometry, view, camera)
    tracer.close()
    assert len(np.unique(geom)) == 3  # ground, wall and card
    assert (geom == own["geom"]).mean() > 0.999  # a ray may meet the very edge of a texel
    same = (geom == own["geom"]) & (geom >= 0)
    assert np.abs(range_m - own["range"])[same].max() < 1e-3


SCENE = """\
name: plain
description: a grey ground and a black pole
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: map.xml}
"""
MAP = """\
<mujoco><worldbody>
  <geom name="ground" type="plane" size="0 0 1" rgba="0.7 0.7 0.7 1"/>
  <geom name="pole" type="box" size="0.15 0.15 20" pos="6 0 0" rgba="0 0 0 1"/>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedFrames]:
    folder = tmp_path_factory.mktemp("plain")
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "map.xml").write_text(MAP)
    frames = SharedFrames(load_world(load_scene(folder / "scene.yaml")))
    tracer_or_skip(frames.geometry).users += 1
    yield frames
    tracer_of(frames.geometry).close()


def test_level_ground_has_the_light_of_the_sky_and_the_sun(plain: SharedFrames) -> None:
    # The exposure is set for a white surface on level ground at this sun (45 degrees), so the ground has the value of
    # its albedo; without specular light, as it has no material. The white balance corrects four fifths of the colour.
    camera = CameraModel.from_fov(96, 72, 40.0)
    renderer = plain.renderer(
        camera, shadows=True, supersample=1, near_m=0.05, far_m=100.0, colour="path_traced", samples=256
    )
    rgb = channel_array("rgb", camera)
    plain.expect(0)
    renderer.render(camera_pose(np.array([-20.0, 0.0, 5.0]), looking(0.0, 90.0)), {"rgb": rgb})
    albedo = ((0.7 + 0.055) / 1.055) ** 2.4
    expected = to_srgb(np.full((1, 1, 3), albedo), 1.0, np.ones(3))[0, 0]
    assert abs(rgb.reshape(-1, 3).mean() - expected.mean()) < 1.5
    assert rgb[4:-4, 4:-4].reshape(-1, 3).std(axis=0).max() < 1.0


def test_a_shadow_lies_where_the_sun_casts_it(plain: SharedFrames) -> None:
    camera = CameraModel.from_fov(160, 120, 60.0)
    renderer = plain.renderer(
        camera, shadows=True, supersample=1, near_m=0.05, far_m=100.0, colour="path_traced", samples=32
    )
    rgb = channel_array("rgb", camera)
    plain.expect(0)
    sun = plain.world.scene.light.to_sun_W
    # The pole at x = 6 m casts a straight shadow away from the sun; the camera is above a point of it.
    foot = np.array([6.0 - 5.0 * sun[0] / math.hypot(*sun[:2]), -5.0 * sun[1] / math.hypot(*sun[:2]), 0.0])
    renderer.render(camera_pose(foot + np.array([0.0, 0.0, 3.0]), looking(0.0, 90.0)), {"rgb": rgb})
    assert int(rgb[60, 80].sum()) < 0.75 * int(rgb[20, 20].sum())
    assert int(rgb[60, 80].sum()) > 0.1 * int(rgb[20, 20].sum())  # the sky lights it


def test_a_rolling_shutter_bends_the_pole_as_the_raster_does(plain: SharedFrames) -> None:
    columns = {}
    for colour in ("native", "path_traced"):
        overrides = {"resolution": (160, 120), "channels": ("rgb",), "rolling_shutter_s": 0.05, "colour": colour}
        camera = make_sensor(
            Installation("front", rate_hz=10.0, seed=1, scene=plain.world.scene, step_ns=4_000_000, frames=plain),
            preset="camera_320x240",
            overrides=overrides,
        )
        zero = (0.0, 0.0, 0.0)
        spinning = TruthState(
            0, 0, (0.0, 0.0, 2.0), (1.0, 0.0, 0.0, 0.0), zero, (0.0, 0.0, 3.0), zero, zero, (0.0,) * 4, False
        )
        sample = camera.sample(spinning, 0)
        assert isinstance(sample, ImageSample)
        dark = sample.channels["rgb"].sum(axis=2) < 200
        rows = np.flatnonzero(dark.sum(axis=1) >= 1)
        columns[colour] = {int(row): float(np.flatnonzero(dark[row]).mean()) for row in rows}
    both = sorted(columns["native"].keys() & columns["path_traced"].keys())
    assert len(both) > 60
    native, traced = (np.array([columns[colour][row] for row in both]) for colour in ("native", "path_traced"))
    assert np.ptp(native) > 5.0  # the pole is bent
    assert np.abs(native - traced).mean() < 0.6


RELIEF = """\
<mujoco><asset>
  <texture name="tilted" type="2d" builtin="flat" width="16" height="16" rgb1="{r} {g} 0.85"/>
  <material name="bent" rgba="0.7 0.7 0.7 1" specular="0"><layer role="normal" texture="tilted"/></material>
</asset><worldbody><geom name="slab" type="box" size="9 9 0.1" material="bent"/></worldbody></mujoco>
"""


def test_a_texture_of_normals_turns_a_surface_to_the_sun(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    sun = load_scene(tmp_path / "scene.yaml").light.to_sun_W
    codes = []
    for sign in (-1.0, 0.0, 1.0):  # away from the sun, flat, towards it; u grows along x, v along y
        r, g = (0.5 + sign * 0.35 * sun[axis] for axis in (0, 1))
        (tmp_path / "map.xml").write_text(RELIEF.format(r=r, g=g))
        frames = SharedFrames(load_world(load_scene(tmp_path / "scene.yaml")))
        tracer_or_skip(frames.geometry)
        camera = CameraModel.from_fov(32, 24, 40.0)
        rgb = channel_array("rgb", camera)
        renderer = frames.renderer(
            camera, shadows=True, supersample=1, near_m=0.05, far_m=100.0, colour="path_traced", samples=64
        )
        renderer.render(camera_pose(np.array([0.0, 0.0, 4.0]), looking(0.0, 90.0)), {"rgb": rgb})
        frames.close()
        codes.append(float(rgb.mean()))
    assert codes[0] + 15.0 < codes[1] < codes[2] - 5.0


def test_the_light_of_a_scene_scales_sun_and_sky() -> None:
    default = sky_request(Light(), 0.0)
    assert default.sun_rgb == (1.0, 1.0, 1.0)
    assert default.ambient_rgb == (1.0, 1.0, 1.0)
    assert default.haze_sun == (1.0, 1.0, 1.0)
    foggy = sky_request(Light(sun_rgb=(0.5, 0.48, 0.44)), 0.01)
    assert foggy.sun_rgb == pytest.approx((0.5, 0.5, 0.5))
    assert foggy.haze_sun[0] < 0.1
    assert foggy.turbidity > default.turbidity
