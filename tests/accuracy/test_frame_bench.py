"""The comparisons of the raster and LiDAR benchmarks, and the failure of an empty comparison."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from hil.apps.bench_suite.sensors import raster
from hil.apps.bench_suite.sensors.raster_errors import Errors
from lab import lidar
from lab.lidar import LidarScene, park, shapes, vehicles


def good() -> Errors:
    return Errors(*(np.zeros(9) for _ in range(4)), np.ones(9, bool), np.ones(9, bool))


@pytest.mark.parametrize("last", [False, True])
def test_a_scene_without_compared_pixels_fails_every_check(last: bool) -> None:
    assert all(check.ok for check in raster._error_checks({"a": good(), "b": good()}))
    scenes = {"a": good(), "b": Errors()} if last else {"a": Errors(), "b": good()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not any(check.ok for check in raster._error_checks(scenes))


@pytest.mark.parametrize("make", [park, vehicles, lambda: shapes(100)])
def test_both_casters_see_the_same_scene(make: Callable[[], LidarScene]) -> None:
    prepared = make()
    prepared.origins_W = prepared.origins_W[:1]
    own_row, mujoco_row, differing = lidar._compare(prepared, "16x900", rounds=1)
    assert differing == 0
    assert max(own_row.error, mujoco_row.error) < 1e-5
