"""`hil bench detect`: how well and how fast the shipped detector finds things, by back end and input size.

Pictures are recorded for it, in worlds that training never saw: scenes, maps, light, people, heights and camera angles
by seeds of their own. Error is 1 - mean average precision (IoU 0.5, all points), time that of one picture on one core
from the camera's picture to boxes. Back ends that are not installed are rows without figures. Beside them stand the
rates of the AirLoop paper's table 8, MobileNet-SSD on a Jetson Nano; its precision is not given there.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hil.bench_suite.detect_cases import Looked, apart_px, at_size, fresh_pictures, load_model, look
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.signals.errors import RecordingError

BACKENDS = ("opencv", "onnxruntime", "pytorch")
PAPER = {"PyTorch": 4.6, "TensorRT": 8.76}  # frames a second, table 8
_SIZES = ((160, 112), (240, 176), (480, 352), (640, 480))  # besides the model's own; multiples of 16
_SETS, _FRAMES = (12, 50), (3, 24)  # of the whole benchmark, and of a quick one
_LEAST_PERSON, _LEAST_ALL, _MOST_FALSE, _LEAST_HZ, _MOST_APART_PX = 0.80, 0.65, 0.2, 40.0, 1.0
_WORDS = 160  # of why something was not measured
PERSON, ALL = "person", "all classes"


def measure(*, quick: bool, say: Callable[[str], None]) -> BenchmarkResult:
    """Raises HilError where no pictures can be made, or the weights are not there."""
    result = BenchmarkResult(time_label="processor time of a picture on one core [s]")
    model = load_model()
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        sets, frames = _FRAMES if quick else _SETS
        pictures = fresh_pictures(Path(folder), sets=sets, frames=frames, say=say)
        at_own: dict[str, Looked] = {}
        for backend in BACKENDS:
            say(f"{backend}, {len(pictures)} pictures")
            try:
                at_own[backend] = look(backend, model, pictures)
            except RecordingError as error:
                _add_missing(result, backend, str(error))
                continue
            _add(result, at_own[backend])
        for size_px in () if quick else _SIZES:
            for backend in at_own:
                say(f"{backend} at {size_px[0]}x{size_px[1]}")
                try:
                    _add(result, look(backend, at_size(model, size_px), pictures))
                except RecordingError as error:
                    _add_missing(result, f"{backend} @ {size_px[0]}x{size_px[1]}", str(error))
    if at_own:
        _check(result, at_own, model.score_threshold)
    if quick:
        result.left_out.append(f"input sizes besides {model.input_px[0]}x{model.input_px[1]}")
        result.left_out.append(f"precision on {_SETS[0] * _SETS[1]} pictures ({len(pictures)} were taken)")
    return result


def _add(result: BenchmarkResult, looked: Looked) -> None:
    width, height = looked.size_px
    evaluation = looked.evaluation
    details: dict[str, Any] = {
        "backend": looked.backend,
        "input_px": [width, height],
        "frames_per_s": 1.0 / looked.time_s,
        "wall_s": looked.wall_s,
        "pictures": evaluation.pictures,
        "false_boxes_per_picture": evaluation.false_boxes(),
        "paper_frames_per_s": PAPER,
    }
    method = f"{looked.backend} @ {width}x{height}"
    for case, value in ((ALL, evaluation.mean_average_precision), (PERSON, _person(looked))):
        result.rows.append(
            Row(case, method, 1.0 - value, "1 - AP", looked.time_s, details | {"average_precision": value})
        )


def _add_missing(result: BenchmarkResult, method: str, why: str) -> None:
    why = why if len(why) <= _WORDS else f"{why[:_WORDS]}..."
    result.rows.append(Row(ALL, method, math.nan, "1 - AP", math.nan, {"not_measured": why}))
    result.left_out.append(f"{method}: {why}")


def _person(looked: Looked) -> float:
    judged = looked.evaluation.judged.get(PERSON)
    return math.nan if judged is None else judged.average_precision


def _check(result: BenchmarkResult, at_own: dict[str, Looked], threshold: float) -> None:
    first = next(iter(at_own.values()))
    quick_ones = [looked for name, looked in at_own.items() if name != "pytorch"]
    best_hz = max((1.0 / looked.time_s for looked in quick_ones), default=math.nan)
    size = f"{first.size_px[0]}x{first.size_px[1]}"
    result.checks += [
        Check("AP@0.5 of people in new worlds", _person(first), ">=", _LEAST_PERSON, "1"),
        Check("mAP@0.5 over all classes", first.evaluation.mean_average_precision, ">=", _LEAST_ALL, "1"),
        Check("false boxes a picture at the threshold", first.evaluation.false_boxes(), "<=", _MOST_FALSE, "1"),
        Check(f"pictures a second at {size} on one core, without PyTorch", best_hz, ">=", _LEAST_HZ, "1/s"),
    ]
    for name, looked in at_own.items():
        if looked is first:
            continue
        worst, alone, compared = apart_px(first.detections, looked.detections, threshold)
        words = f"{first.backend} and {name}: {compared} boxes"
        result.checks += [
            Check(f"{words}, edges apart at most", worst, "<=", _MOST_APART_PX, "px"),
            Check(f"{words}, found by one alone", float(alone), "<=", 0.0, "boxes"),
        ]
    if len(at_own) == 1:
        result.left_out.append("boxes of one back end beside another's: only one is installed")
