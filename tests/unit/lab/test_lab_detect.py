"""Parts of `hil bench detect` that need no weights: comparing boxes, rows that say what is missing, its picture."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from hil.apps.bench_suite.result import BenchmarkResult, Row, work_precision_plot
from hil.run.report.run_json import finite
from lab import detect
from lab.detect_cases import BackendResult, box_differences, load_model
from signals.errors import RecordingError

from hil.apps.detect.evaluate import Evaluation  # isort: skip
from hil.apps.detect.pictures import Picture  # isort: skip
from hil_companion.detect import model_file  # isort: skip
from hil_companion.detect.decode import Detection  # isort: skip


def box(x: float, score: float = 0.9, label: str = "person") -> Detection:
    return Detection(label, (x, 10.0, x + 20.0, 60.0), score)


def test_boxes_of_two_back_ends_are_compared_both_ways() -> None:
    assert box_differences([[box(10.0), box(50.0)]], [[box(10.25), box(50.0)]], 0.5) == (0.25, 0, 4)
    assert box_differences([[box(10.0)]], [[]], 0.5) == (0.0, 1, 1)
    assert box_differences([[]], [[box(10.0)]], 0.5) == (0.0, 1, 1)
    assert box_differences([[box(10.0)]], [[box(10.0, label="vehicle")]], 0.5)[1] == 2
    # At the threshold a rounding decides: a box in only one of the lists is not a fault.
    assert box_differences([[box(10.0, 0.501)]], [[box(10.0, 0.499)]], 0.5) == (0.0, 0, 1)


def test_missing_measurements_are_rows_with_a_note(tmp_path: Path) -> None:
    result = BenchmarkResult()
    details = {"backend": "opencv", "input_px": [320, 240]}
    for case in (detect.ALL, detect.PERSON):
        result.rows.append(Row(case, "opencv @ 320x240", 0.2, "1 - AP", 0.02, details))
    detect._add_missing(result, "onnxruntime", "back end onnxruntime is not installed here; pip install onnxruntime")
    rows = json.loads(json.dumps(finite(result.as_json("detect")), allow_nan=False))["rows"]
    assert rows[-1]["error"] is None
    assert "not installed" in rows[-1]["not_measured"]
    assert math.isnan(result.rows[-1].time_s)
    work_precision_plot(result, "a title", tmp_path / "detect.png")
    assert (tmp_path / "detect.png").read_bytes().startswith(b"\x89PNG")


def test_each_model_is_held_to_its_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has a time of its own: the fast model passes, the good one does not."""

    def run(backend: str, model: model_file.ModelFile, pictures: list[Picture]) -> BackendResult:
        time_s = {"opencv": 0.026, "onnxruntime": 0.027, "pytorch": 0.001}[backend]
        time_s = time_s if model.path == model_file.SHIPPED[model_file.GOOD] else 0.5 * time_s
        evaluation = Evaluation({}, 1, model.score_threshold)
        return BackendResult(backend, model.input_px, evaluation, time_s, time_s, [[]])

    monkeypatch.setattr(detect, "run_backend", run)
    monkeypatch.setattr(detect, "fresh_pictures", lambda *_, **__: [])
    result = detect.measure(quick=True, status=lambda _: None)
    rates = {c.name.split(" at ")[0]: c for c in result.checks if "pictures per second" in c.name}
    assert rates["pictures per second"].ok
    assert not rates["good, pictures per second"].ok
    assert rates["good, pictures per second"].value == pytest.approx(1.0 / 0.026)


def test_missing_weights_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(model_file.SHIPPED, model_file.FAST, tmp_path / "none.onnx")
    with pytest.raises(RecordingError, match=r"none\.onnx"):
        load_model()
