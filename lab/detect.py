"""`hil bench detect`: precision and speed of the shipped detectors, by back end and input size.

Pictures are recorded for the benchmark in worlds that were not used for training: scenes, maps, light, people, heights
and camera angles have their own seeds. The error is 1 - mean average precision (IoU 0.5, all points); the time is that
of one picture on one core, from the camera's picture to boxes. Rows of back ends that are not installed have no values.
For comparison the rows hold the rates of table 8 of the AirLoop paper (MobileNet-SSD on a Jetson Nano), which gives no
precision.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from lab.detect_cases import (
    BackendResult,
    at_size,
    box_differences,
    fresh_pictures,
    load_model,
    run_backend,
)
from signals.errors import RecordingError

from hil_companion.detect.model_file import GOOD  # isort: skip

TITLE = "Detector: loss of precision against time per picture"
BACKENDS = ("opencv", "onnxruntime", "pytorch")
PAPER = {"PyTorch": 4.6, "TensorRT": 8.76}  # frames per second, table 8
_OTHER_SIZES = ((160, 112), (240, 176), (480, 352), (640, 480))  # besides the model's own; multiples of 16
_FULL_SETS, _QUICK_SETS = (12, 50), (3, 24)  # number of data sets, frames of each
_MIN_PERSON, _MIN_ALL, _MAX_FALSE, _MIN_RATE_HZ, _MAX_DIFFERENCE_PX = 0.80, 0.65, 0.2, 40.0, 1.0
_MAX_REASON = 160  # characters
PERSON, ALL = "person", "all classes"


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Record pictures and run every back end. Raises HilError if no pictures can be made or the weights are missing."""
    result = BenchmarkResult(time_label="processor time per picture on one core [s]")
    model = load_model()
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        sets, frames = _QUICK_SETS if quick else _FULL_SETS
        pictures = fresh_pictures(Path(folder), sets=sets, frames=frames, status=status)
        at_model_size: dict[str, BackendResult] = {}
        for backend in BACKENDS:
            status(f"{backend}, {len(pictures)} pictures")
            try:
                at_model_size[backend] = run_backend(backend, model, pictures)
            except RecordingError as error:
                _add_missing(result, backend, str(error))
                continue
            _add(result, at_model_size[backend])
        good = load_model(GOOD)
        good_runs: dict[str, BackendResult] = {}
        for backend in at_model_size:
            status(f"{backend}, the good model")
            good_runs[backend] = run_backend(backend, good, pictures)
            _add(result, good_runs[backend], f"{GOOD}, ")
        for size_px in () if quick else _OTHER_SIZES:
            for backend in at_model_size:
                status(f"{backend} at {size_px[0]}x{size_px[1]}")
                try:
                    _add(result, run_backend(backend, at_size(model, size_px), pictures))
                except RecordingError as error:
                    _add_missing(result, f"{backend} @ {size_px[0]}x{size_px[1]}", str(error))
    if at_model_size:
        _check(result, at_model_size, model.score_threshold)
        result.checks.append(_rate_check(good_runs, f"{GOOD}, "))
    if quick:
        result.left_out.append(f"input sizes other than {model.input_px[0]}x{model.input_px[1]}")
        result.left_out.append(f"precision on {_FULL_SETS[0] * _FULL_SETS[1]} pictures ({len(pictures)} were taken)")
    return result


def _add(result: BenchmarkResult, run: BackendResult, model: str = "") -> None:
    width, height = run.size_px
    evaluation = run.evaluation
    details: dict[str, Any] = {
        "backend": run.backend,
        "input_px": [width, height],
        "frames_per_s": 1.0 / run.time_s,
        "wall_s": run.wall_s,
        "pictures": evaluation.pictures,
        "false_boxes_per_picture": evaluation.false_boxes(),
        "paper_frames_per_s": PAPER,
    }
    method = f"{model}{run.backend} @ {width}x{height}"
    for case, value in ((ALL, evaluation.mean_average_precision), (PERSON, _person(run))):
        result.rows.append(Row(case, method, 1.0 - value, "1 - AP", run.time_s, details | {"average_precision": value}))


def _add_missing(result: BenchmarkResult, method: str, reason: str) -> None:
    reason = reason if len(reason) <= _MAX_REASON else f"{reason[:_MAX_REASON]}..."
    result.rows.append(Row(ALL, method, math.nan, "1 - AP", math.nan, {"not_measured": reason}))
    result.left_out.append(f"{method}: {reason}")


def _person(run: BackendResult) -> float:
    people = run.evaluation.classes.get(PERSON)
    return math.nan if people is None else people.average_precision


def _check(result: BenchmarkResult, at_model_size: dict[str, BackendResult], threshold: float) -> None:
    first = next(iter(at_model_size.values()))
    result.checks += [
        Check("AP@0.5 of people in new worlds", _person(first), ">=", _MIN_PERSON, "1"),
        Check("mAP@0.5 over all classes", first.evaluation.mean_average_precision, ">=", _MIN_ALL, "1"),
        Check("false boxes per picture at the threshold", first.evaluation.false_boxes(), "<=", _MAX_FALSE, "1"),
        _rate_check(at_model_size),
    ]
    for name, run in at_model_size.items():
        if run is first:
            continue
        difference_px, unmatched, compared = box_differences(first.detections, run.detections, threshold)
        words = f"{first.backend} and {name}: {compared} boxes"
        result.checks += [
            Check(f"{words}, greatest distance of edges", difference_px, "<=", _MAX_DIFFERENCE_PX, "px"),
            Check(f"{words}, found by only one", float(unmatched), "<=", 0.0, "boxes"),
        ]
    if len(at_model_size) == 1:
        result.left_out.append("comparison of boxes between back ends: only one is installed")


def _rate_check(runs: dict[str, BackendResult], model: str = "") -> Check:
    """Return the check of the fastest back end that is flown with: a picture takes 25 ms at most."""
    best_hz = max((1.0 / run.time_s for name, run in runs.items() if name != "pytorch"), default=math.nan)
    width, height = next(iter(runs.values())).size_px
    words = f"{model}pictures per second at {width}x{height} on one core, without PyTorch"
    return Check(words, best_hz, ">=", _MIN_RATE_HZ, "1/s", "speed")
