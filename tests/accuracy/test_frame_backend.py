"""MuJoCo's own renderers as colour backends: their pixels lie on the raster's. Skipped without OpenGL or Vulkan."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster import MujocoRenderer, buffers
from hil.apps.bench_suite.sensors.raster_cases import Case, camera_pose, looking, scene_case
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import ColourBackendError, MujocoColour, egl_problem, filament_problem
from sim.frame.renderer import FrameRenderer
from sim.frame.scenery import open_texels
from sim.frame.source import SharedFrames, channel_array
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.worlds.patience import PATIENCE_S

CAMERA = CameraModel.from_fov(160, 120, 90.0)


@pytest.fixture(scope="module")
def park() -> Case:
    return scene_case("city_park", views=4, seed=5)


@pytest.mark.parametrize("camera", [CAMERA, replace(CAMERA, cx=71.5, cy=66.25)], ids=["centred", "off_centre"])
def test_silhouettes_agree_with_the_raster(park: Case, camera: CameraModel) -> None:
    if egl_problem():
        pytest.skip(egl_problem())
    geometry = FrameGeometry(park.world)
    renderer, out = FrameRenderer(geometry, camera), buffers(camera, ("geom", "depth"))
    holed = list(open_texels(park.world.model))
    colour = MujocoColour(park.world, camera)
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    try:
        for view in park.views:
            geometry.pose(view.t_ns)
            renderer.render(view.pose, out)
            colour.pose(view.t_ns)
            # MuJoCo draws a plane without end only so far.
            near = out["depth"] < 100.0
            # MuJoCo's ids ignore holes.
            theirs = colour.geom_ids(view.pose)
            near &= ~np.isin(theirs, holed) & ~np.isin(out["geom"], holed)
            assert (theirs == out["geom"])[near].mean() >= 0.99
            colour.render(view.pose, rgb)
            assert rgb.std() > 5.0
    finally:
        colour.close()


def test_planes_are_the_cameras_and_the_shared_model_is_left_alone(park: Case) -> None:
    if egl_problem():
        pytest.skip(egl_problem())
    camera = CameraModel.from_fov(2000, 150, 90.0)  # wider than the buffers in the map's settings
    size = park.world.model.vis.global_
    before = (size.offwidth, size.offheight)
    assert camera.width > before[0]
    geometry = FrameGeometry(park.world)
    renderer, out = FrameRenderer(geometry, camera), buffers(camera, ("depth",))
    view = park.views[1]  # looks down
    geometry.pose(view.t_ns)
    renderer.render(view.pose, out)
    leaves = list(open_texels(park.world.model))
    middle_m = float(np.median(out["depth"][out["depth"] < 60.0]))
    for planes in ({"near_m": 0.05, "far_m": middle_m}, {"near_m": middle_m, "far_m": 60.0}):
        colour = MujocoColour(park.world, camera, **planes)
        try:
            colour.pose(view.t_ns)
            ids = colour.geom_ids(view.pose)
            # MuJoCo draws the holes of meshes opaque.
            seen = (ids >= 0) & ~np.isin(ids, leaves)
        finally:
            colour.close()
        depth, low, high = np.where(np.isin(ids, leaves), np.nan, out["depth"]), planes["near_m"], planes["far_m"]
        assert seen[(depth > 1.01 * low) & (depth < 0.99 * high)].mean() > 0.99
        # Behind a clipped near geom another may be visible; beyond the far plane there is nothing. On an edge the
        # renderers may see either side.
        nearest = cv2.erode(out["depth"], np.ones((3, 3), np.uint8))
        assert not seen[nearest > 1.01 * high].any()
    rival = MujocoRenderer(park, camera, shadows=False)
    rival.close()
    assert (size.offwidth, size.offheight) == before
    assert park.world.model.vis.quality.offsamples == mujoco.MjSpec().compile().vis.quality.offsamples


@pytest.mark.parametrize(
    "said", ["glfw", *(pytest.param(name, marks=pytest.mark.slow) for name in ("disabled", "egl"))]
)
def test_the_renderer_is_found_for_every_mujoco_gl_at_import(said: str) -> None:
    if egl_problem():
        pytest.skip(egl_problem())
    script = "from sim.frame.mujoco_backend import egl_problem; print(egl_problem())"
    child = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"MUJOCO_GL": said, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    assert child.stdout.strip() == ""


def test_filament_shows_what_the_classic_renderer_shows(park: Case) -> None:
    if egl_problem() or filament_problem():
        pytest.skip(egl_problem() or filament_problem())
    edges = []
    for backend in ("egl", "filament"):
        colour = MujocoColour(park.world, CAMERA, backend=backend)
        rgb = np.zeros((120, 160, 3), np.uint8)
        try:
            colour.pose(park.views[0].t_ns)
            colour.render(park.views[0].pose, rgb)
        finally:
            colour.close()
        edges.append(np.abs(np.diff(rgb.astype(float).sum(axis=2), axis=1)))
    here = np.corrcoef(edges[0].ravel(), edges[1].ravel())[0, 1]
    beside = np.corrcoef(edges[0][:, 2:].ravel(), edges[1][:, :-2].ravel())[0, 1]
    assert here > beside + 0.1


def test_unsupported_drawings_are_refused_with_a_reason(park: Case) -> None:
    bent = CameraModel.from_fov(160, 120, 90.0, BrownConrady(-0.1, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ColourBackendError, match="pinhole"):
        MujocoColour(park.world, bent)
    with pytest.raises(ColourBackendError, match="no colour backend 'vulkan'"):
        MujocoColour(park.world, CAMERA, backend="vulkan")
    with pytest.raises(ColourBackendError, match="square pixels"):
        MujocoColour(park.world, replace(CAMERA, fy=70.0))
    with pytest.raises(ColourBackendError, match="middle"):
        MujocoColour(park.world, replace(CAMERA, cx=70.0), backend="filament")


def test_a_camera_with_colour_from_mujoco_keeps_the_rasters_other_channels() -> None:
    if egl_problem():
        pytest.skip(egl_problem())
    frames = SharedFrames(load_world(load_scene("radar_range")))
    camera = CameraModel.from_fov(64, 48, 80.0)
    options = {"shadows": False, "supersample": 1, "near_m": 0.05, "far_m": 10_000.0}
    pose = camera_pose(np.array([-4.0, 0.0, 1.8]), looking(0.0, 10.0))
    pictures = {}
    for colour in ("native", "egl"):
        frames.expect(1_500_000_000)
        out = {name: channel_array(name, camera) for name in ("rgb", "depth", "instance")}
        out["rgb"][:] = 7
        renderer = frames.renderer(camera, colour=colour, **options)
        renderer.render(pose, out, rows=(0, 24))
        pictures[colour] = out
    frames.close()
    assert (pictures["egl"]["rgb"][24:] == 7).all()
    assert np.abs(pictures["egl"]["rgb"][:24].astype(int) - pictures["native"]["rgb"][:24]).mean() < 80.0
    assert (pictures["egl"]["rgb"][:24] != pictures["native"]["rgb"][:24]).any()
    for name in ("depth", "instance"):
        assert np.array_equal(pictures["egl"][name][:24], pictures["native"][name][:24])
