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
    place = park() if scene == "park" else shapes(100)
    place.origins_W = place.origins_W[:1]
    ours, theirs, apart = lidar._compare(place, "16x900", turns=1)
    assert apart == 0
    assert max(ours.error, theirs.error) < 1e-5
