"""Average precision against figures worked out by hand and against pycocotools."""

from __future__ import annotations

import contextlib
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from hil.apps.detect.pictures import Picture
from hil.config.companion.clients import make_client_importable

make_client_importable()
from hil_companion.detect.decode import Detection  # noqa: E402

from hil.apps.detect.average_precision import (  # noqa: E402
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
    ClassResult,
    evaluate_classes,
    match_detections,
)
from hil.apps.detect.command import _print_table  # noqa: E402
from hil.apps.detect.evaluate import evaluation_of  # noqa: E402

Box = tuple[float, float, float, float]


def picture(objects: list[tuple[str, Box]], hard: list[bool] | None = None) -> Picture:
    boxes = np.array([b for _, b in objects], np.float32).reshape(-1, 4)
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    difficult = np.array(hard if hard is not None else [False] * len(objects), bool)
    return Picture(Path("none.png"), 320, 240, boxes, tuple(n for n, _ in objects), difficult, areas)


A, B = (10.0, 10.0, 30.0, 50.0), (100.0, 10.0, 120.0, 50.0)


def test_each_object_is_found_once() -> None:
    pictured = picture([("person", A), ("person", B)])
    right, wrong = TRUE_POSITIVE, FALSE_POSITIVE
    shifted = (12.0, 10.0, 32.0, 50.0)  # IoU 18 / 22
    found = [Detection("person", box, s) for box, s in ((shifted, 0.9), (A, 0.8), (B, 0.7), ((200, 0, 220, 40), 0.6))]
    assert match_detections(found, pictured, "person", 0.5) == [right, wrong, right, wrong]
    assert match_detections(found, pictured, "person", 0.9) == [wrong, right, right, wrong]


def test_difficult_objects_count_neither_way() -> None:
    pictured = picture([("person", A), ("person", B)], [True, False])
    found = [Detection("person", A, 0.9), Detection("person", A, 0.8)]
    assert match_detections(found, pictured, "person", 0.5) == [IGNORED, IGNORED]
    judged = evaluate_classes([pictured], [found], ["person"])["person"]
    assert (judged.objects, len(judged.scores), judged.average_precision) == (1, 0, 0.0)


def test_area_under_the_curve_worked_out_by_hand() -> None:
    right = np.array([True, False, True, False, False, True])
    judged = ClassResult(np.linspace(0.9, 0.4, 6), right, 4)
    # Recall 1/4 at precision 1, 2/4 at 2/3, 3/4 at 3/6, and one is never found.
    assert judged.average_precision == pytest.approx((1.0 + 2.0 / 3.0 + 0.5) / 4.0)
    assert judged.counts_at(0.65) == (2, 1)
    assert ClassResult(np.zeros(0), np.zeros(0, bool), 3).average_precision == 0.0
    assert math.isnan(ClassResult(np.zeros(0), np.zeros(0, bool), 0).average_precision)


def test_a_class_that_is_never_there_does_not_count_in_the_mean_but_its_false_boxes_do() -> None:
    pictures = [picture([("person", A)]), picture([])]
    found = [[Detection("person", A, 0.9), Detection("vehicle", B, 0.8)], [Detection("vehicle", B, 0.6)]]
    result = evaluation_of(0.7, pictures, found, ("person", "vehicle"))
    assert result.mean_average_precision == 1.0
    assert result.false_boxes() == 0.5
    assert result.false_boxes(0.5) == 1.0
    assert result.threshold_for(0.5) == pytest.approx(0.61)
    assert result.false_boxes(result.threshold_for(0.5)) <= 0.5
    assert result.threshold_for(0.0) == pytest.approx(0.81)
    assert result.threshold_for(9.0) == 0.01


def test_against_pycocotools() -> None:
    """Objects far from one another, so that both rules match alike; COCO's curve is ours at 101 recalls."""
    coco_module = pytest.importorskip("pycocotools.coco")
    coco_eval = pytest.importorskip("pycocotools.cocoeval")
    rng = np.random.default_rng(7)
    pictures, found = [], []
    for _ in range(30):
        objects, detections = [], []
        for i in range(int(rng.integers(0, 5))):
            x, y = 70.0 * i + rng.uniform(0, 20), rng.uniform(0, 150)
            box = (x, y, x + 30.0, y + 60.0)
            label = str(rng.choice(["person", "vehicle"]))
            objects.append((label, box))
            for _ in range(int(rng.integers(0, 3))):
                moved = tuple(float(v + rng.normal(0.0, 4.0)) for v in box)
                kind = label if rng.random() < 0.8 else "person"
                detections.append(Detection(kind, moved, float(rng.uniform(0.05, 1.0))))  # type: ignore[arg-type]
        pictures.append(picture(objects))
        found.append(sorted(detections, key=lambda d: -d.score))
    names = ("person", "vehicle")
    judged = evaluate_classes(pictures, found, names)
    truth = coco_module.COCO()
    annotations: list[dict[str, Any]] = []
    results: list[dict[str, Any]] = []
    for i, (p, ds) in enumerate(zip(pictures, found, strict=True)):
        for name, (x0, y0, x1, y1) in zip(p.labels, p.boxes_px.tolist(), strict=True):
            size = {"bbox": [x0, y0, x1 - x0, y1 - y0], "area": (x1 - x0) * (y1 - y0), "iscrowd": 0}
            annotations.append(
                {"id": len(annotations) + 1, "image_id": i + 1, "category_id": 1 + names.index(name), **size}
            )
        for d in ds:
            x0, y0, x1, y1 = d.box_px
            box = [x0, y0, x1 - x0, y1 - y0]
            results.append({"image_id": i + 1, "category_id": 1 + names.index(d.label), "bbox": box, "score": d.score})
    truth.dataset = {
        "images": [{"id": i + 1, "width": 320, "height": 240} for i in range(len(pictures))],
        "annotations": annotations,
        "categories": [{"id": 1 + i, "name": n} for i, n in enumerate(names)],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        truth.createIndex()
        evaluation = coco_eval.COCOeval(truth, truth.loadRes(results), "bbox")
        evaluation.params.iouThrs = np.array([0.5])
        evaluation.evaluate()
        evaluation.accumulate()
    for i, name in enumerate(names):
        j = judged[name]
        right = np.cumsum(j.correct)
        recall, precision = right / j.objects, right / np.arange(1, len(right) + 1)
        best = np.maximum.accumulate(precision[::-1])[::-1]
        # As COCO does: the best precision at the first point that reaches the recall.
        at = np.searchsorted(recall, np.linspace(0.0, 1.0, 101), side="left")
        ours = np.where(at < len(best), best[np.minimum(at, len(best) - 1)], 0.0)
        theirs = evaluation.eval["precision"][0, :, i, 0, -1]
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
        assert j.average_precision == pytest.approx(theirs.mean(), abs=0.02)


@pytest.mark.parametrize(
    ("objects", "words"), [([("person", A)], "mAP@0.5 of the model's classes 0.000"), ([], "warning: no")]
)
def test_pictures_without_objects_are_told_and_give_no_nan(objects: list[tuple[str, Box]], words: str) -> None:
    said = io.StringIO()
    result = evaluation_of(0.5, [picture(objects)], [[]], ["person"])
    _print_table(result, Console(file=said, width=200), "test")
    assert words in said.getvalue()
    assert "nan" not in said.getvalue()


def test_objects_that_the_model_cannot_find_are_told() -> None:
    """Its average precision was called that of all classes."""
    said = io.StringIO()
    result = evaluation_of(0.5, [picture([("person", A), ("lorry", A), ("lorry", A)])], [[]], ["person"])
    _print_table(result, Console(file=said, width=200), "test")
    assert "not evaluated, classes that the model does not have: lorry (2)" in said.getvalue()
    assert result.as_json()["not_evaluated"] == {"lorry": 2}
