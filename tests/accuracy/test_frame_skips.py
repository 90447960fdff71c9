"""A skipping rule leaves out work that cannot affect the outputs: each one alone, on and off, gives the same bits."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import Case, field_case, scene_case
from hil.apps.bench_suite.sensors.skip import compare, contact_rule, lidar_rules, radar_rule, raster_rules
from signals.samples import TruthState
from sim.frame.camera_model import CameraModel
from sim.frame.renderer import RenderSkips

CAMERA = CameraModel.from_fov(92, 66, 90.0)  # not whole blocks of 4 x 4


@pytest.fixture(scope="module")
def park() -> Case:
    return scene_case("city_park", views=2, seed=3)


def test_pictures_are_the_same_with_and_without_each_rule(park: Case) -> None:
    rules = raster_rules(park, CAMERA)
    assert len(rules) == len(fields(RenderSkips)) + 1  # the rule for unused channels is not a field
    assert {rule.name: compare(rule, rounds=1)[1] for rule in rules} == {rule.name: 0.0 for rule in rules}


def test_pictures_of_many_geoms_are_the_same_with_and_without_each_rule() -> None:
    rules = raster_rules(field_case(800, seed=2, views=3), CAMERA)
    assert {rule.name: compare(rule, rounds=1)[1] for rule in rules} == {rule.name: 0.0 for rule in rules}


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
        _, found = next(rule.run(False))
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
