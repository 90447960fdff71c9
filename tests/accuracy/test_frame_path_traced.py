"""Path-traced colour: its geometry against the raster's, its light against closed forms (extra `photo`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import Case, camera_pose, looking, scene_case
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady, KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.renderer import PathTracedRenderer, PathTracer, tracer_of
from sim.frame.path_traced.sky_request import sky_request
from sim.frame.path_traced.tone import to_srgb
from sim.frame.renderer import FrameRenderer
from sim.frame.source import SharedFrames, channel_array
from sim.scene.scene import load_scene
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
    for view in park.views:
        geom, range_m = tracer.surfaces(number, view.pose, view.t_ns)
        own = raster(geometry, view, camera)
        near = geom == own["geom"]
        for x, y in ((-0.1, 0), (0.1, 0), (0, -0.1), (0, 0.1)):
            shifted = replace(camera, cx=camera.cx + x, cy=camera.cy + y)
            near |= geom == raster(geometry, view, shifted)["geom"]
        assert near.mean() > 0.9999
        same = (geom == own["geom"]) & (geom >= 0) & (own["range"] < 60.0)
        assert same.mean() > 0.3
        assert np.quantile(np.abs(range_m - own["range"])[same], 0.99) < 1e-3


def test_a_picture_is_the_same_again_and_shows_the_scene(park: Case, geometry: FrameGeometry) -> None:
    camera = LENSES["pinhole"]
    renderer = PathTracedRenderer(FrameRenderer(geometry, camera), tracer_of(geometry), samples=8)
    native = FrameRenderer(geometry, camera, shadows=True)
    for view in (park.views[0], park.views[1], park.views[0]):
        geometry.expect(view.t_ns)
        traced, drawn = channel_array("rgb", camera), channel_array("rgb", camera)
        renderer.render(view.pose, {"rgb": traced})
        native.render(view.pose, {"rgb": drawn})
        # The two models of light differ, but their edges and textures are the same.
        correlation = np.corrcoef(traced.mean(axis=2).ravel(), drawn.mean(axis=2).ravel())[0, 1]
        assert correlation > 0.75
        if view is park.views[0]:
            first = traced if view.t_ns not in (seen := locals().setdefault("pictures", {})) else seen[view.t_ns]
            assert np.array_equal(traced, first)
    renderer.close()
