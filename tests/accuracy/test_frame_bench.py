"""The comparisons of the raster and LiDAR benchmarks, and the failure of an empty comparison."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from hil.apps.bench_suite.sensors import lidar, raster
from hil.apps.bench_suite.sensors.lidar import park, shapes
from hil.apps.bench_suite.sensors.raster_errors import Errors


def good() -> Errors:
    return Errors(*(np.zeros(9) for _ in range(4)), np.ones(9, bool), np.ones(9, bool))


@pytest.mark.parametrize("last", [False, True])
def test_a_scene_without_compared_pixels_fails_every_check(last: bool) -> None:
    assert all(check.ok for check in raster._error_checks({"a": good(), "b": good()}))
    scenes = {"a": good(), "b": Errors()} if last else {"a": Errors(), "b": good()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not any(check.ok for check in raster._error_checks(scenes))


@pytest.mark.parametrize("scene", ["park", "shapes"])
def test_both_casters_see_the_same_scene(scene: str) -> None:
    prepared = park() if scene == "park" else shapes(100)
    prepared.origins_W = prepared.origins_W[:1]
    own_row, mujoco_row, differing = lidar._compare(prepared, "16x900", rounds=1)
    assert differing == 0
    assert max(own_row.error, mujoco_row.error) < 1e-5
