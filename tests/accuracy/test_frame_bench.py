"""What the benchmarks of raster and LiDAR compare, and that a comparison of nothing meets no check."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from hil.bench_suite import lidar, raster
from hil.bench_suite.lidar import PATTERNS, park, shapes
from hil.bench_suite.raster_cases import Case, field_case
from hil.bench_suite.raster_errors import Errors, errors, truth
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import FrameRenderer

CAMERA = CameraModel.from_fov(160, 120, 90.0)


@pytest.fixture(scope="module")
def field() -> Case:
    return field_case(3000, seed=4, views=2)


def good() -> Errors:
    return Errors(*(np.zeros(9) for _ in range(4)), np.ones(9, bool), np.ones(9, bool))


@pytest.mark.parametrize("last", [False, True])
def test_a_scene_in_which_nothing_was_compared_meets_no_check(last: bool) -> None:
    assert all(check.ok for check in raster._error_checks({"a": good(), "b": good()}))
    scenes = {"a": good(), "b": Errors()} if last else {"a": Errors(), "b": good()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not any(check.ok for check in raster._error_checks(scenes))


def test_pixels_are_drawn_until_enough_lie_away_from_silhouettes(field: Case) -> None:
    view, pixels = field.views[0], 600
    true = truth(field, view, WorldPose(field.world), CAMERA, pixels, seed=3)
    assert true.inside[:pixels].sum() < 0.8 * pixels  # a picture full of silhouettes
    assert true.inside.sum() >= pixels
    assert len(true.rows) == len(true.depth_m) == len(true.normal_C) > pixels
    # All pixels are judged by the first draw: later ones would weigh what lies away from silhouettes no more than that.
    random = np.random.Generator(np.random.Philox(3))
    assert true.drawn == pixels
    assert np.array_equal(true.rows[:pixels], random.integers(1, CAMERA.height - 1, pixels))
    renderer = FrameRenderer(FrameGeometry(field.world), CAMERA)
    frame = renderer.buffers("instance", "depth", "geom")
    renderer.render(view.pose, frame)
    found = errors(frame, true, field.world.model)
    assert len(found.id_agrees_anywhere) == pixels
    assert len(found.id_agrees) == true.inside.sum()
    assert found.id_agrees.mean() > 0.999
    assert found.depth_m.max() < 1e-3
    frame["instance"][true.rows[pixels:], true.columns[pixels:]] += 1  # wrong where only the later draws look
    spoilt = errors(frame, true, field.world.model)
    assert spoilt.id_agrees.mean() < 0.9
    assert spoilt.id_agrees_anywhere.mean() > found.id_agrees_anywhere.mean() - 0.1


def test_a_view_of_silhouettes_alone_comes_to_an_end(field: Case) -> None:
    tiny = CameraModel.from_fov(8, 6, 120.0)
    true = truth(field, field.views[0], WorldPose(field.world), tiny, 50, seed=1)
    assert len(true.rows) <= 8 * 50


def test_rays_away_from_silhouettes_count_whatever_they_meet() -> None:
    inf = np.inf
    a = (np.array([1.0, 2.0, 3.0, inf, 5.0]), np.array([0, 1, 2, -1, 4], np.int32))
    b = (np.array([1.5, 4.0, 3.0, inf, 7.0]), np.array([0, 9, 2, -1, 4], np.int32))
    nowhere, second = np.zeros(5, bool), np.array([False, True, False, False, False])
    assert lidar.difference_m(a, (b[0], a[1]), nowhere) == 2.0
    assert lidar.difference_m((a[0][:4], a[1][:4]), (b[0][:4], b[1][:4]), nowhere[:4]) == 0.5
    assert lidar.difference_m((a[0][:4], a[1][:4]), (b[0][:4], b[1][:4]), second[:4]) == 2.0
    missed = (np.array([inf]), np.array([-1], np.int32))
    assert lidar.difference_m(missed, (np.array([3.0]), np.array([4], np.int32)), np.ones(1, bool)) == inf
    assert lidar.difference_m(missed, missed, np.ones(1, bool)) == 0.0


def test_neighbours_are_those_of_channel_and_column() -> None:
    channels, columns, _ = PATTERNS["16x900"]
    geom = np.zeros((columns, channels), np.int32)
    geom[0, 3] = 7
    inside = lidar._away_from_silhouettes(geom.reshape(-1), "16x900").reshape(columns, channels)
    others = np.argwhere(~inside).tolist()
    assert others == [[0, 2], [0, 3], [0, 4], [1, 3], [columns - 1, 3]]


@pytest.mark.parametrize("scene", ["park", "shapes"])
def test_both_casters_see_the_same_scene(scene: str) -> None:
    place = park() if scene == "park" else shapes(100)
    place = replace(place, origins_W=place.origins_W[:1])
    ours, theirs, apart = lidar._compare(place, "16x900", turns=1)
    assert apart == 0
    assert max(ours.error, theirs.error) < 1e-5
