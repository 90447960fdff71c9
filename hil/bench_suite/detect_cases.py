"""Parts of `hil bench detect`: fresh pictures with labels, a detector timed and judged on them, and boxes compared."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from hil.companion.started import use_client
from hil.signals.errors import RecordingError

use_client()

from hil_companion.detect.decode import Detection  # noqa: E402
from hil_companion.detect.detector import Detector  # noqa: E402
from hil_companion.detect.model_file import ModelFile, all_anchors_px  # noqa: E402
from hil_companion.errors import CompanionError  # noqa: E402

from hil.detect.data_sets import make_data_sets  # noqa: E402
from hil.detect.evaluate import LOWEST_SCORE, Evaluation, judged_at  # noqa: E402
from hil.detect.picture_store import read_rgb  # noqa: E402
from hil.detect.pictures import Picture, read_data_sets  # noqa: E402

# Of maps, looks and noise: far from those of training, whose seeds count up from a few thousand (MODEL_CARD.md).
FIRST_SEED = 910_000
_REPEATS = 3  # of each picture's time the least counts: what else the machine does only adds
_TIMED_MOST = 40  # pictures


@dataclass(frozen=True)
class Looked:
    """One back end at one input size on all pictures."""

    backend: str
    size_px: tuple[int, int]
    evaluation: Evaluation
    time_s: float  # processor time of one picture on one core, from picture to boxes: median
    wall_s: float  # the same by the clock
    detections: list[list[Detection]]


def fresh_pictures(folder: Path, *, sets: int, frames: int, say: Callable[[str], None]) -> list[Picture]:
    """Recorded now, in worlds that training never saw. HilError."""
    say(f"recording {sets} data sets of {frames} frames in new worlds")
    quiet = Console(quiet=True)
    made = make_data_sets(folder, quiet, sets=sets, frames=frames, first_seed=FIRST_SEED, jobs=1, quiet=True)
    return read_data_sets(made)


def at_size(model: ModelFile, size_px: tuple[int, int]) -> ModelFile:
    """The same weights for another input: the network is made of convolutions alone."""
    if size_px == model.input_px:
        return model
    return replace(model, input_px=size_px, anchors_px=all_anchors_px(model.levels, size_px))


def look(backend: str, model: ModelFile, pictures: Sequence[Picture]) -> Looked:
    """RecordingError in words where this back end cannot."""
    try:
        detector = Detector(model, backend, threads=1, threshold=LOWEST_SCORE)
        flown = Detector(model, backend, threads=1)  # at its own threshold, as it flies: that is timed
        detector.warm_up()
        flown.warm_up()
        found, cpu_s, wall_s = [], [], []
        for i, picture in enumerate(pictures):
            rgb = read_rgb(picture)
            found.append(detector.detect(rgb))
            if i < _TIMED_MOST:
                cpu, wall = _least_s(flown, rgb)
                cpu_s.append(cpu)
                wall_s.append(wall)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
    evaluation = judged_at(model.score_threshold, pictures, found, model.classes)
    return Looked(backend, model.input_px, evaluation, float(np.median(cpu_s)), float(np.median(wall_s)), found)


def _least_s(detector: Detector, rgb: np.ndarray) -> tuple[float, float]:
    cpu_s = wall_s = math.inf
    for _ in range(_REPEATS):
        cpu_ns, wall_ns = time.process_time_ns(), time.perf_counter_ns()
        detector.detect(rgb)
        wall_s = min(wall_s, (time.perf_counter_ns() - wall_ns) * 1e-9)
        cpu_s = min(cpu_s, (time.process_time_ns() - cpu_ns) * 1e-9)
    return cpu_s, wall_s


def apart_px(
    ours: Sequence[Sequence[Detection]], theirs: Sequence[Sequence[Detection]], threshold: float
) -> tuple[float, int, int]:
    """Greatest distance of a box's edges between two back ends, boxes that only one has, and how many were compared.

    Boxes of a score within a hundredth of the threshold may be on either side of it: those have to be in the other's
    list at all.
    """
    worst, alone, compared = 0.0, 0, 0
    for mine, other in zip(ours, theirs, strict=True):
        for a, b in ((mine, other), (other, mine)):
            for one in (d for d in a if d.score >= threshold):
                near = [
                    max(abs(p - q) for p, q in zip(one.box_px, d.box_px, strict=True))
                    for d in b
                    if d.label == one.label and d.score >= threshold - 0.01
                ]
                compared += 1
                if not near or min(near) > 8.0:
                    alone += 1
                else:
                    worst = max(worst, min(near))
    return worst, alone, compared


def load_model() -> ModelFile:
    """The shipped one. RecordingError where it is not there."""
    try:
        return ModelFile.load(None)
    except CompanionError as error:
        raise RecordingError(str(error)) from None
