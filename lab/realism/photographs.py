"""Check of the detectors on real photographs, in which people have marked what there is to find."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import TextTable
from hil.config.companion.clients import make_client_importable
from lab.realism.kinds import group_labels
from lab.realism.networks import Detector, Found
from signals.errors import RecordingError

make_client_importable()

from hil_companion.detect.decode import overlaps  # noqa: E402
from hil_companion.detect.detector import Detector as OwnDetector  # noqa: E402
from hil_companion.detect.model_file import SHIPPED, ModelFile  # noqa: E402

_MIN_IOU = 0.5
_GREY = 114
# Group and box (x_min, y_min, x_max, y_max) of the objects in the photographs [px].
OBJECTS: dict[str, tuple[tuple[str, tuple[float, float, float, float]], ...]] = {
    "bus.jpg": (
        ("vehicle", (22.0, 231.0, 805.0, 756.0)),
        ("person", (50.0, 398.0, 245.0, 903.0)),
        ("person", (223.0, 405.0, 345.0, 858.0)),
        ("person", (669.0, 392.0, 810.0, 877.0)),
    ),
    "zidane.jpg": (
        ("person", (747.0, 41.0, 1142.0, 712.0)),
        ("person", (144.0, 200.0, 1107.0, 711.0)),
    ),
}
# Photographs for this project's detector alone.
MORE_OBJECTS: dict[str, tuple[tuple[str, tuple[float, float, float, float]], ...]] = {
    "astronaut.png": (("person", (20.0, 14.0, 362.0, 512.0)),),
    "camera.png": (("person", (0.0, 64.0, 330.0, 512.0)),),
}
_ALL_OBJECTS = {**OBJECTS, **MORE_OBJECTS}
# People in photographs fill the picture; those of the data sets are mostly a tenth to a third as high.
SCALES = {1.0: "whole", 0.5: "half", 0.25: "quarter"}
_LOW_SCORE = 0.3
# Objects that each network finds from its threshold when it is run correctly.
EXPECTED = {"ssd-mobilenetv2": 4}


def read_photograph(content: bytes) -> NDArray[np.uint8]:
    """Return a photograph as (height, width, 3) RGB. Raises RecordingError."""
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise RecordingError("a photograph of the packages cannot be decoded")
    return np.ascontiguousarray(picture[:, :, ::-1])


def with_margins(rgb: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], float, float]:
    """Return the picture with grey margins to 4 : 3, the shape of the frames, and the margins left and above [px]."""
    height, width = rgb.shape[:2]
    wide, tall = max(width, round(height * 4 / 3)), max(height, round(width * 3 / 4))
    left, top = (wide - width) // 2, (tall - height) // 2
    out = np.full((tall, wide, 3), _GREY, np.uint8)
    out[top : top + height, left : left + width] = rgb
    return out, float(left), float(top)


def found_in(detector: Detector, photographs: Mapping[str, bytes]) -> tuple[int, dict[str, list[Found]]]:
    """Return the number of marked objects that a detector finds, and its boxes from its threshold by photograph."""
    count = 0
    boxes: dict[str, list[Found]] = {}
    for name, objects in OBJECTS.items():
        picture, left, top = with_margins(read_photograph(photographs[name]))
        found = [one for one in detector.detect(picture)[0] if one.score >= detector.threshold]
        boxes[name] = found
        for group, place in objects:
            labels = group_labels(group)
            places = np.array([one.box_px for one in found if one.label in labels]).reshape(-1, 4)
            marked = np.array(place) + np.array([left, top, left, top])
            count += bool((overlaps(marked, places) >= _MIN_IOU).any())
    return count, boxes


def own_detector_table(photographs: Mapping[str, bytes]) -> TextTable:
    """Return what the shipped detectors, trained on drawn pictures alone, find of the marked people and vehicles."""
    table = TextTable(
        ("shipped detector", "people", "vehicles", "false people and vehicles"),
        [],
        f"found at IoU {_MIN_IOU:g} of those marked in {', '.join(photographs)}; half, quarter: shrunk, with "
        "grey around them",
    )
    marked = Counter(group for name in photographs for group, _ in _ALL_OBJECTS[name])
    for model_name in SHIPPED:
        model = ModelFile.load(model_name)
        detector = OwnDetector(model, threshold=_LOW_SCORE)
        for threshold in (model.score_threshold, _LOW_SCORE):
            for scale, text in SCALES.items():
                counts = [_own_counts(detector, n, content, scale, threshold) for n, content in photographs.items()]
                people, vehicles, false = (sum(c[key] for c in counts) for key in ("person", "vehicle", "false"))
                cells = (f"{people} of {marked['person']}", f"{vehicles} of {marked['vehicle']}", str(false))
                table.rows.append((f"{model_name}, from {threshold:g}, {text}", *cells))
    return table


def _own_counts(detector: OwnDetector, name: str, content: bytes, scale: float, threshold: float) -> Counter[str]:
    """Return the number of people and vehicles found in a photograph, and of false boxes of both."""
    picture, left, top = with_margins(read_photograph(content))
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    canvas = np.full_like(picture, _GREY)
    canvas[: small.shape[0], : small.shape[1]] = small
    boxes = [one for one in detector.detect(canvas) if one.score >= threshold]
    counts: Counter[str] = Counter()
    for group in ("person", "vehicle"):
        own = np.array([one.box_px for one in boxes if one.label == group]).reshape(-1, 4)
        right = np.zeros(len(own), bool)
        for place in (np.array(box) for label, box in _ALL_OBJECTS[name] if label == group):
            fits = overlaps(scale * (place + np.array([left, top, left, top])), own) >= _MIN_IOU
            counts[group] += bool(fits.any())
            right |= fits
        counts["false"] += int((~right).sum())
    return counts
