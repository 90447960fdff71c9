"""`hil bench NAME --errors-only`, which CI runs, takes every step of speed once: a step that breaks is found there."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

import lab.dataset
import lab.lidar
from hil.apps.bench_suite.link import link
from hil.apps.bench_suite.result import BenchmarkResult
from hil.apps.bench_suite.sensors import raster
from lab.dataset_cases import Rate, differing_files
from signals.errors import RecordingError


def silent(_text: str) -> None:
    pass


def breaks(*_: Any, **__: Any) -> Any:
    raise RecordingError("broken")


def rate(*_: Any, frames: int = 21, **__: Any) -> Rate:
    return Rate(frames, 1.0, 10.0, float(frames))


STEPS: list[tuple[Any, str, Callable[..., BenchmarkResult]]] = [
    (lab.dataset, "lower_bound_s", lab.dataset.measure),
    (lab.dataset, "measure_stored", lab.dataset.measure),
    (lab.dataset, "measure_unstored", lab.dataset.measure),
    (lab.lidar, "_out_of_range", lab.lidar.measure),
    (link, "_pace", link.measure),
    (raster._Measurement, "times_of_scene", raster.measure),
    (raster._Measurement, "field", raster.measure),
    (raster._Measurement, "hidden_geoms", raster.measure),
]


@pytest.fixture(autouse=True)
def nothing_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab.dataset, "_errors", lambda *_: 0.0)
    monkeypatch.setattr(lab.dataset, "plan_of", lambda *_, **__: nullcontext())
    for name, value in (("lower_bound_s", 0.01), ("measure_stored", None), ("measure_unstored", None)):
        monkeypatch.setattr(lab.dataset, name, rate if value is None else lambda *_: 0.01)
    monkeypatch.setattr(lab.lidar, "PATTERNS", {})
    monkeypatch.setattr(lab.lidar, "_checks", lambda *_: [])
    for name in ("park", "vehicles", "shapes"):
        monkeypatch.setattr(lab.lidar, name, lambda *_: None)
    for name in ("_measure_messages", "measure_flights", "measure_transfers"):
        monkeypatch.setattr(link, name, lambda *_, **__: None)
    monkeypatch.setattr(raster._Measurement, "errors", lambda *_: None)
    monkeypatch.setattr(raster, "_error_checks", lambda _: [])
    monkeypatch.setattr(raster, "scene_case", lambda *_, **__: None)


@pytest.mark.parametrize(("where", "step", "measure"), STEPS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_step_of_speed_that_breaks_is_an_error(
    where: Any, step: str, measure: Callable[..., BenchmarkResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("times_of_scene", "field", "hidden_geoms", "speed_checks"):
        if step in raster._Measurement.__dict__:
            monkeypatch.setattr(raster._Measurement, name, lambda *_: None)
    monkeypatch.setattr(where, step, breaks)
    with pytest.raises(RecordingError, match="broken"):
        measure(quick=True, status=silent, errors_only=True)


def test_how_fast_the_smallest_data_set_was_is_not_told() -> None:
    result = lab.dataset.measure(quick=True, status=silent, errors_only=True)
    assert (result.rows, result.checks) == ([], [])


def test_frames_that_took_no_measurable_time_have_no_rate() -> None:
    assert Rate(20, 1.0, 10.0, processor_s=3.0).per_processor_s(Rate(10, 1.0, 10.0, processor_s=2.0)) > 0.0
    assert math.isnan(Rate(20, 1.0, 10.0, processor_s=2.0).per_processor_s(Rate(10, 1.0, 10.0, processor_s=2.0)))


def test_files_that_differ_are_named(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for root in (one, other):
        (root / "data").mkdir(parents=True)
        (root / "data/same.csv").write_text("1\n")
        (root / "data/other.csv").write_text(root.name)
    assert differing_files(one, one) == []
    (other / "more").write_text("")
    assert differing_files(one, other) == ["data/other.csv", "more"]
