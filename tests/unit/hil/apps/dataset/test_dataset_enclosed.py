"""A data set whose sensor is below the ground or inside something says so: its pictures looked like any others."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from hil.apps.dataset.command import run_dataset
from hil.apps.dataset.enclosed_sensors import EnclosedSensors
from hil.apps.dataset.make import MakeOptions
from hil.apps.dataset.moments import Batch, DueSample, Moment
from hil.apps.dataset.plan import EPOCH_NS
from hil.config import load_bench
from signals.errors import ConfigError
from signals.samples import TruthState, Vec3
from sim.physics.enclosed_points import EnclosedPoints
from tests.worlds.small_dataset import Inline, tiny_plan


def moment(number: int, p_WB: Vec3, *sensors: str) -> Moment:
    zero = (0.0, 0.0, 0.0)
    truth = TruthState(number, number * 1000, p_WB, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), False)
    return Moment(truth, tuple(DueSample(name, number, None) for name in sensors), number)


def test_some_samples_below_the_ground_are_told_with_the_first(tmp_path: Path) -> None:
    plan = tiny_plan(tmp_path, frames=10, settings=("sensors.front.mount_m=[0, 0, -1]",))
    enclosed = EnclosedSensors(plan)
    heights_m = (2.0, 0.5, 0.9, 2.0)
    enclosed.add(Batch(0, 0, 4, tuple(moment(i, (2.0, -25.5, z), "front", "radar") for i, z in enumerate(heights_m))))
    enclosed.add(Batch(1, 4, 1, (moment(4, (2.0, -25.5, 0.5), "lidar"),)))
    (warning,) = enclosed.warnings()
    assert warning.startswith("front was inside something solid in 2 of 4 samples, which show nothing of the scene")
    assert warning.endswith(f"the first is {EPOCH_NS + 1000}, inside 'ground'")
    assert enclosed.problems() == []


def test_a_point_is_inside_what_is_solid_there(tmp_path: Path) -> None:
    bench = tiny_plan(tmp_path, frames=1).bench
    points = EnclosedPoints(bench.scene, bench.vehicle)
    places = [(x, y) for x in range(-60, 61, 4) for y in range(-60, 61, 4)]
    built = {points.around((x, y, 2.0)) for x, y in places}
    assert "'building_000'" in built
    assert "" in built
    assert {points.around((x, y, 300.0)) for x, y in places} == {""}
    assert "" not in {points.around((x, y, -1.0)) for x, y in places}


def test_a_point_deep_below_terrain_is_inside_it() -> None:
    """The solid of a height field has a floor; a point below that was free."""
    bench = load_bench(scene="landscape_mountains")
    points = EnclosedPoints(bench.scene, bench.vehicle)
    for x, y in ((0.0, 0.0), (100.0, 50.0)):
        assert {points.around((x, y, -depth_m)) for depth_m in (2.0, 20.0, 200.0)} == {"'Landscape_0'"}
        assert points.around((x, y, 400.0)) == ""
    assert points.around((5e4, 0.0, -20.0)) == "", "beside the terrain there is none"


@pytest.mark.parametrize(("down_m", "is_refused"), [(-9.0, True), (0.05, False)])
def test_a_data_set_that_shows_nothing_is_an_error(down_m: float, is_refused: bool, tmp_path: Path) -> None:
    plan = tiny_plan(tmp_path / "bench", frames=4, settings=(f"sensors.front.mount_m=[0, 0, {down_m}]",))
    said = Console(file=io.StringIO(), width=300)
    options = MakeOptions(quiet=True, workers=1, make_workers=Inline)
    if not is_refused:
        assert not run_dataset(said, tmp_path / "out", options, lambda _: plan).problems
        return
    with pytest.raises(ConfigError) as caught:
        run_dataset(said, tmp_path / "out", options, lambda _: plan)
    (problem,) = caught.value.problems
    assert str(problem).startswith("sensors.front.mount_m: puts the sensor inside 'ground' in all of its 4 samples")
    assert (tmp_path / "out" / "dataset.json").exists()
