"""A data set without a fault or the samples of a sensor that its bench declares says so."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from hil.apps.dataset.command import run_dataset
from hil.apps.dataset.flight import FlightRecorder
from hil.apps.dataset.make import MakeOptions
from hil.run.parts.simulated.unmet_faults import Unmet
from tests.worlds.small_dataset import Inline, tiny_plan


def test_faults_that_no_flight_met_are_told(tmp_path: Path) -> None:
    faults = "{sensor: gps, kind: dropout, at_s: 0.05, until_s: 0.15}, {sensor: gps, kind: freeze, at_s: 500}"
    plan = tiny_plan(tmp_path / "bench", frames=8, settings=(f"faults.sensors=[{faults}]",))
    options = MakeOptions(quiet=True, workers=1, make_workers=Inline)
    (warning,) = run_dataset(Console(file=io.StringIO()), tmp_path / "out", options, lambda _: plan).warnings
    assert warning.startswith("not in the data set: fault of gps: freeze at 500 s never began: the flight ended at ")


def test_sensors_without_a_sample_or_a_return_are_told_of(tmp_path: Path) -> None:
    slow = "sensors.slow={preset: ist8310, rate_hz: 0.002, autopilot: false}"
    plan = tiny_plan(tmp_path / "bench", frames=4, settings=(slow, "sensors.lidar.min_range_m=99.9"))
    options = MakeOptions(quiet=True, workers=1, make_workers=Inline)
    warnings = run_dataset(Console(file=io.StringIO()), tmp_path / "out", options, lambda _: plan).warnings
    assert warnings[0].startswith("slow has no sample in the ")
    assert warnings[1].startswith("lidar has no return in any of ")


def test_one_flight_that_met_it_is_enough(tmp_path: Path) -> None:
    recorder = FlightRecorder(tiny_plan(tmp_path, frames=4), lambda *_: None)
    recorder.flown([Unmet("gust", "in the first flight", True), Unmet("drop", "also", True)])
    recorder.flown([Unmet("gust", "in the second flight", True)])
    assert [one.text for one in recorder.unmet or ()] == ["in the first flight"]
    recorder.flown([])
    assert recorder.unmet == []
