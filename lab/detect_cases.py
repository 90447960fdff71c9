"""Cases of `hil bench detect`: new labelled pictures, time and precision of detectors on them, comparison of boxes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from hil.apps.bench_suite.result import ShowStatus
from hil.config.companion.clients import make_client_importable
from signals.errors import RecordingError

make_client_importable()

from hil_companion.detect.decode import Detection  # noqa: E402
from hil_companion.detect.detector import Detector  # noqa: E402
from hil_companion.detect.model_file import FAST, ModelFile, all_anchors_px  # noqa: E402
from hil_companion.errors import CompanionError  # noqa: E402

from hil.apps.detect.data_sets import DataSetSeries, make_data_sets  # noqa: E402
from hil.apps.detect.evaluate import LOWEST_SCORE, Evaluation, evaluation_of  # noqa: E402
from hil.apps.detect.picture_store import read_rgb  # noqa: E402
from hil.apps.detect.pictures import Picture, read_data_sets  # noqa: E402

# First seed of maps, appearance and noise. Seeds of the training data start at a few thousand (MODEL_CARD.md).
FIRST_SEED = 910_000
_REPEATS = 3  # the shortest time of each picture counts, because other load on the machine can only add to it
_MAX_TIMED = 40  # pictures
_MAX_MATCH_PX = 8.0  # between edges of boxes that may match


@dataclass(frozen=True)
class BackendResult:
    """Result of one back end at one input size on all pictures. Times are medians per picture, on one core."""

    backend: str
    size_px: tuple[int, int]  # width, height
    evaluation: Evaluation
    time_s: float  # processor time from picture to boxes
    wall_s: float  # wall-clock time
    detections: list[list[Detection]]


def fresh_pictures(folder: Path, *, sets: int, frames: int, status: ShowStatus) -> list[Picture]:
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
        timed = Detector(model, backend, threads=1)  # with the threshold of the model, as in flight
        detector.warm_up()
        timed.warm_up()
        detections, cpu_s, wall_s = [], [], []
        for i, picture in enumerate(pictures):
            rgb = read_rgb(picture)
            detections.append(detector.detect(rgb))
            if i < _MAX_TIMED:
                cpu, wall = _shortest_s(timed, rgb)
                cpu_s.append(cpu)
                wall_s.append(wall)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
    evaluation = evaluation_of(model.score_threshold, pictures, detections, model.classes)
    return BackendResult(
        backend, model.input_px, evaluation, float(np.median(cpu_s)), float(np.median(wall_s)), detections
    )


def _shortest_s(detector: Detector, rgb: np.ndarray) -> tuple[float, float]:
    cpu_s = wall_s = math.inf
    for _ in range(_REPEATS):
        cpu_ns, wall_ns = time.process_time_ns(), time.perf_counter_ns()
        detector.detect(rgb)
        wall_s = min(wall_s, (time.perf_counter_ns() - wall_ns) * 1e-9)
        cpu_s = min(cpu_s, (time.process_time_ns() - cpu_ns) * 1e-9)
    return cpu_s, wall_s


def box_differences(
    first: Sequence[Sequence[Detection]], second: Sequence[Sequence[Detection]], threshold: float
) -> tuple[float, int, int]:
    """Compare the boxes of two back ends, picture by picture.

    Return the greatest distance of matching edges [px], the number of boxes that only one back end found, and the
    number compared. A box above the threshold may match one up to 0.01 below the threshold, because of rounding.
    """
    difference_px, unmatched, compared = 0.0, 0, 0
    for first_boxes, second_boxes in zip(first, second, strict=True):
        for a, b in ((first_boxes, second_boxes), (second_boxes, first_boxes)):
            for box in (d for d in a if d.score >= threshold):
                distances_px = [
                    max(abs(p - q) for p, q in zip(box.box_px, d.box_px, strict=True))
                    for d in b
                    if d.label == box.label and d.score >= threshold - 0.01
                ]
                compared += 1
                if not distances_px or min(distances_px) > _MAX_MATCH_PX:
                    unmatched += 1
                else:
                    difference_px = max(difference_px, min(distances_px))
    return difference_px, unmatched, compared


def load_model(name: str = FAST) -> ModelFile:
    """Load a shipped model. Raises RecordingError if it is missing."""
    try:
        return ModelFile.load(name)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
