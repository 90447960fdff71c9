"""Smoothed outlines: colour by coverage where ids differ, as before elsewhere, and no other channel changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.raster_cases import Case, camera_pose, looking, scene_case
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import Execution, FrameRenderer, RenderSkips
from sim.frame.shading import FULL, PLAIN, Shading
from tests.accuracy.test_frame_shading import geometry_of, linear
from tests.unit.sim.frame.test_frame_raster import ISAS, picture

PINHOLE = CameraModel.from_fov(118, 90, 90.0)  # not whole blocks of 4 x 4
FISHEYE = CameraModel.from_fov(118, 90, 150.0, KannalaBrandt(0.02, 0.0, 0.0, 0.0))
SHARP, SMOOTH = replace(FULL, smooth_edges=False), FULL
LABELS = ("depth", "range", "segmentation", "instance", "geom", "normal", "material")


@pytest.fixture(scope="module")
def park() -> Case:
    return scene_case("city_park", views=3, seed=5)


@pytest.fixture(scope="module")
def geometry(park: Case) -> FrameGeometry:
    return FrameGeometry(park.world)


def outlines(geom: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return the pixels that see another geom than one beside, above or below."""
    found = np.zeros(geom.shape, bool)
    across, down = geom[:, 1:] != geom[:, :-1], geom[1:] != geom[:-1]
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= down
    found[:-1] |= down
    return found


def by_coverage(
    sharp: NDArray[np.uint8], geom: NDArray[np.int32], fine: NDArray[np.uint8], fine_geom: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the light of every pixel from the rule of sim/native/frame/outlines.hpp; `fine`: twice as many pixels."""
    height, width = geom.shape
    light, fine_light = linear(sharp.astype(float)), linear(fine.astype(float))
    rows, columns = np.mgrid[:height, :width]
    total = np.zeros_like(light)
    for k in range(4):
        dx, dy = (1 if k & 1 else -1), (1 if k >> 1 else -1)
        seen, own = fine_geom[k >> 1 :: 2, k & 1 :: 2], fine_light[k >> 1 :: 2, k & 1 :: 2]
        steps = [(0, 0), (dx, 0), (0, dy), (dx, dy), (-dx, 0), (0, -dy), (-dx, dy), (dx, -dy), (-dx, -dy)]
        sample = own.copy()
        for x, y in reversed(steps):  # the nearest is written last
            beside = np.clip(rows + y, 0, height - 1), np.clip(columns + x, 0, width - 1)
            matches = geom[beside] == seen
            sample[matches] = light[beside][matches]
        total += sample
    return total / 4.0


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_outlines_are_smoothed_by_coverage_and_all_else_is_as_before(
    park: Case, geometry: FrameGeometry, camera: CameraModel
) -> None:
    sharp, smooth, samples, four = (
        FrameRenderer(geometry, seen_by, shadows=True, **told)
        for seen_by, told in (
            (camera, {"shading": SHARP}),
            (camera, {"shading": SMOOTH}),
            (camera.scaled(2), {"shading": SHARP}),
            (camera, {"shading": SHARP, "supersample": 2}),
        )
    )
    for view in park.views:
        geometry.pose(view.t_ns)
        a, b = (picture(renderer, view.pose, "rgb", *LABELS) for renderer in (sharp, smooth))
        for name in LABELS:
            assert a[name].tobytes() == b[name].tobytes(), name
        edge = outlines(a["geom"])
        assert 0.01 < edge.mean() < 0.5
        assert np.array_equal(b["rgb"][~edge], a["rgb"][~edge])
        fine = picture(samples, view.pose, "rgb", "geom")
        light = by_coverage(a["rgb"], a["geom"], fine["rgb"], fine["geom"])[edge]
        code = 255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
        assert np.abs(b["rgb"][edge] - code).max() < 1.0  # its table of codes, and the rounding
        exact = linear(picture(four, view.pose, "rgb")["rgb"][edge].astype(float))
        errors = [np.abs(linear(x["rgb"][edge].astype(float)) - exact).mean() for x in (a, b)]
        assert errors[1] < 0.6 * errors[0], errors


def test_smoothed_outlines_are_the_same_however_they_are_made(park: Case, geometry: FrameGeometry) -> None:
    view = park.views[0]
    geometry.pose(view.t_ns)

    def made(**told: object) -> NDArray[np.uint8]:
        renderer = FrameRenderer(geometry, PINHOLE, shadows=True, shading=SMOOTH, execution=Execution(**told))  # type: ignore[arg-type]
        return picture(renderer, view.pose, "rgb")["rgb"]

    expected = made()
    for isa in ISAS:
        assert np.array_equal(made(isa=isa), expected), isa
    for threads in (2, 3):
        assert np.array_equal(made(threads=threads), expected), threads
    for skips in (RenderSkips(occlusion=False), RenderSkips(frustum=False)):
        assert np.array_equal(made(skips=skips), expected), skips


def test_rows_alone_are_those_of_the_whole_picture(park: Case, geometry: FrameGeometry) -> None:
    view = park.views[0]
    geometry.pose(view.t_ns)
    renderer = FrameRenderer(geometry, PINHOLE, shading=SMOOTH)
    whole = picture(renderer, view.pose, "rgb", "depth")
    part = {name: np.zeros_like(array) for name, array in whole.items()}
    for first in range(0, PINHOLE.height, 12):
        last = min(first + 12, PINHOLE.height)
        renderer.render(view.pose, part, rows=(first, last))
        assert not part["rgb"][last:].any()
        assert not part["depth"][last:].any()
    for name, array in whole.items():
        assert np.array_equal(part[name], array), name


def test_the_share_of_an_edge_pixel_is_nearer_to_its_coverage(tmp_path: Path) -> None:
    """A slanted edge between a glowing board and a black one: light is the covered share of each pixel."""
    boards = (
        '<geom type="box" size="5 5 0.1" pos="5 0 10" euler="0 0 17" rgba="1 1 1 1" material="glow"/>'
        '<geom type="box" size="50 50 0.1" pos="0 0 12" rgba="0 0 0 1"/>'
    )
    geometry = geometry_of(tmp_path, '<material name="glow" emission="2"/>', boards)
    camera = CameraModel.from_fov(96, 96, 60.0)
    pose = camera_pose(np.zeros(3), looking(0.0, -90.0))

    def share(shading: Shading, supersample: int = 1) -> NDArray[np.float64]:
        renderer = FrameRenderer(geometry, camera, shading=shading, supersample=supersample)
        return np.asarray(linear(np.asarray(picture(renderer, pose, "rgb")["rgb"][..., 1], float)))

    exact = share(PLAIN, supersample=4)
    partly = (exact > 0.03) & (exact < 0.97)
    assert partly.sum() > 50
    errors = [
        float(np.sqrt(np.mean((share(s) - exact)[partly] ** 2))) for s in (PLAIN, replace(PLAIN, smooth_edges=True))
    ]
    assert errors[0] > 0.25
    assert errors[1] < 0.5 * errors[0]


def test_a_picture_without_outlines_is_as_before(geometry: FrameGeometry) -> None:
    up = camera_pose(np.array([0.0, 0.0, 40.0]), looking(0.0, -90.0))
    sharp, smooth = (picture(FrameRenderer(geometry, PINHOLE, shading=s), up, "rgb") for s in (SHARP, SMOOTH))
    assert np.array_equal(sharp["rgb"], smooth["rgb"])


def test_a_lens_that_ends_within_its_outermost_pixels_keeps_its_sharp_outlines(
    park: Case, geometry: FrameGeometry
) -> None:
    """This lens has no rays beyond 3.45 focal lengths; its outermost centres are at 3.443, their samples at 3.461."""
    camera = CameraModel.from_opencv(100, 100, 20.33, 20.33, 49.5, 49.5, KannalaBrandt(0.01, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="cannot be inverted"):
        camera.scaled(2).rays()
    view = park.views[0]
    geometry.pose(view.t_ns)
    sharp, smooth = (picture(FrameRenderer(geometry, camera, shading=s), view.pose, "rgb") for s in (SHARP, SMOOTH))
    assert np.array_equal(sharp["rgb"], smooth["rgb"])
