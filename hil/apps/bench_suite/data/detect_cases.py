"""Cases of `hil bench detect`: new labelled pictures, detectors timed and evaluated on them, and boxes compared."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from hil.apps.bench_suite.result import Status
from hil.config.companion.clients import add_client_path
from signals.errors import RecordingError

add_client_path()

from hil_companion.detect.decode import Detection  # noqa: E402
from hil_companion.detect.detector import Detector  # noqa: E402
from hil_companion.detect.model_file import ModelFile, all_anchors_px  # noqa: E402
from hil_companion.errors import CompanionError  # noqa: E402

from hil.apps.detect.data_sets import DataSetSeries, make_data_sets  # noqa: E402
from hil.apps.detect.evaluate import LOWEST_SCORE, Evaluation, evaluation_of  # noqa: E402
from hil.apps.detect.picture_store import read_rgb  # noqa: E402
from hil.apps.detect.pictures import Picture, read_data_sets  # noqa: E402

# First seed of maps, appearance and noise. Seeds of the training data start at a few thousand (MODEL_CARD.md).
FIRST_SEED = 910_000
_REPEATS = 3  # the shortest time of each picture counts, because other load on the machine can only add to it
_MAX_TIMED = 40  # pictures


@dataclass(frozen=True)
class BackendResult:
    """Result of one back end at one input size on all pictures. Times are medians per picture, on one core."""

    backend: str
    size_px: tuple[int, int]  # width, height
    evaluation: Evaluation
    time_s: float  # processor time from picture to boxes
    wall_s: float  # wall-clock time
    detections: list[list[Detection]]


def fresh_pictures(folder: Path, *, sets: int, frames: int, status: Status) -> list[Picture]:
    """Record data sets in worlds that were not used for training, and return their pictures. Raises HilError."""
    status(f"recording {sets} data sets of {frames} frames in new worlds")
    series = DataSetSeries(sets, frames, FIRST_SEED)
    return read_data_sets(make_data_sets(folder, Console(quiet=True), series, jobs=1, quiet=True))


def at_size(model: ModelFile, size_px: tuple[int, int]) -> ModelFile:
    """Return the model for another input size (width, height), which a convolutional network allows."""
    if size_px == model.input_px:
        return model
    return replace(model, input_px=size_px, anchors_px=all_anchors_px(model.levels, size_px))


def run_backend(backend: str, model: ModelFile, pictures: Sequence[Picture]) -> BackendResult:
    """Run a back end over the pictures. Raises RecordingError with the reason if it is not available."""
    try:
        detector = Detector(model, backend, threads=1, threshold=LOWEST_SCORE)
        timed = Detector(model, backend, threads=1)  # at its own threshold, as in flight
        detector.warm_up()
        timed.warm_up()
        found, cpu_s, wall_s = [], [], []
        for i, picture in enumerate(pictures):
            rgb = read_rgb(picture)
            found.append(detector.detect(rgb))
            if i < _MAX_TIMED:
                cpu, wall = _shortest_s(timed, rgb)
                cpu_s.append(cpu)
                wall_s.append(wall)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
    evaluation = evaluation_of(model.score_threshold, pictures, found, model.classes)
    return BackendResult(backend, model.input_px, evaluation, float(np.median(cpu_s)), float(np.median(wall_s)), found)


def _shortest_s(detector: Detector, rgb: np.ndarray) -> tuple[float, float]:
    cpu_s = wall_s = math.inf
    for _ in range(_REPEATS):
        cpu_ns, wall_ns = time.process_time_ns(), time.perf_counter_ns()
        detector.detect(rgb)
        wall_s = min(wall_s, (time.perf_counter_ns() - wall_ns) * 1e-9)
        cpu_s = min(cpu_s, (time.process_time_ns() - cpu_ns) * 1e-9)
    return cpu_s, wall_s


def box_differences(
    ours: Sequence[Sequence[Detection]], theirs: Sequence[Sequence[Detection]], threshold: float
) -> tuple[float, int, int]:
    """Compare the boxes of two back ends, picture by picture.

    Returns the greatest distance of matching edges [px], the number of boxes found by one alone, and the number
    compared. A box above the threshold may match one whose score is up to 0.01 below it, because of rounding.
    """
    worst, alone, compared = 0.0, 0, 0
    for mine, other in zip(ours, theirs, strict=True):
        for a, b in ((mine, other), (other, mine)):
            for box in (d for d in a if d.score >= threshold):
                near = [
                    max(abs(p - q) for p, q in zip(box.box_px, d.box_px, strict=True))
                    for d in b
                    if d.label == box.label and d.score >= threshold - 0.01
                ]
                compared += 1
                if not near or min(near) > 8.0:
                    alone += 1
                else:
                    worst = max(worst, min(near))
    return worst, alone, compared


def load_model() -> ModelFile:
    """Load the shipped model. Raises RecordingError if it is missing."""
    try:
        return ModelFile.load(None)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
