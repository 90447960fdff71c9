"""The shipped model: its files, and its detections in a picture outside the training set."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()
from hil_companion.detect.backends import BACKENDS, open_backend  # noqa: E402
from hil_companion.detect.decode import decode, overlaps  # noqa: E402
from hil_companion.detect.detector import Detector  # noqa: E402
from hil_companion.detect.model_file import (  # noqa: E402
    FAST,
    GOOD,
    SHIPPED,
    ModelFile,
    all_anchors_px,
)
from hil_companion.errors import CutError, OptionError  # noqa: E402

# Of the validation pictures: city_park, map seed 800000.
PICTURE = Path(__file__).parents[4] / "worlds" / "detect_people.png"
PEOPLE = ((253.0, 70.0, 266.0, 92.0), (43.0, 69.0, 58.0, 92.0), (217.0, 50.0, 226.0, 70.0))  # by its labels
LEAST = 0.3


INPUT_PX = {FAST: (320, 240), GOOD: (448, 336)}


@pytest.fixture(scope="module", params=SHIPPED)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def model(name: str) -> ModelFile:
    return ModelFile.load(name)


@pytest.fixture(scope="module")
def rgb() -> np.ndarray:
    bgr = cv2.imread(str(PICTURE))
    assert bgr is not None
    return np.ascontiguousarray(bgr[:, :, ::-1])


def test_the_files_are_small_and_belong_together(name: str, model: ModelFile) -> None:
    assert model.path.stat().st_size <= 12e6
    assert model.input_px == INPUT_PX[name]
    assert "person" in model.classes
    assert model.classes == tuple(sorted(model.classes))
    card = (model.path.parents[1] / "MODEL_CARD.md").read_text()
    assert model.sha256 in card


def test_the_fast_model_is_the_one_without_a_name() -> None:
    assert ModelFile.load().path == ModelFile.load(FAST).path == SHIPPED[FAST]
    with pytest.raises(OptionError, match=r"best: weights are fast or good, or a \.onnx file"):
        ModelFile.load("best")


def test_no_file_says_where_it_was_made(model: ModelFile) -> None:
    for file in (model.path, model.path.with_suffix(".json")):
        data = file.read_bytes()
        assert not any(word in data for word in (b"/tmp/", b"/home/", b"site-packages"))


def test_it_detects_the_people(model: ModelFile, rgb: np.ndarray) -> None:
    found = np.array([d.box_px for d in Detector(model, threshold=LEAST).detect(rgb) if d.label == "person"])
    for person in PEOPLE:
        assert overlaps(np.array(person), found).max() > 0.5


def test_nothing_is_found_in_plain_grey(model: ModelFile) -> None:
    detector = Detector(model)
    for grey in range(0, 256, 15):
        assert detector.detect(np.full((480, 640, 3), grey, np.uint8)) == []


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_back_ends_give_the_same_boxes_within_a_pixel(model: ModelFile, rgb: np.ndarray, backend: str) -> None:
    pytest.importorskip(f"hil_companion.detect.backends.{BACKENDS[backend][0]}")
    expected = Detector(model, "opencv", threads=1, threshold=LEAST).detect(rgb)
    found = Detector(model, backend, threads=1, threshold=LEAST).detect(rgb)
    assert len(found) == len(expected) >= len(PEOPLE)
    for a, b in zip(expected, found, strict=True):
        assert a.label == b.label
        assert np.abs(np.subtract(a.box_px, b.box_px)).max() < 1.0
        assert abs(a.score - b.score) < 0.01


def test_pictures_of_any_size_and_boxes_in_their_own_pixels(model: ModelFile, rgb: np.ndarray) -> None:
    detector = Detector(model, threshold=LEAST)
    detector.warm_up()
    large = cv2.resize(rgb, (640, 480), interpolation=cv2.INTER_LINEAR)
    wide = np.full((240, 500, 3), 114, np.uint8)
    wide[:, 90:410] = rgb
    wide = cv2.resize(wide, (1000, 480), interpolation=cv2.INTER_LINEAR)
    found = np.array([d.box_px for d in detector.detect(large) if d.label == "person"])
    assert overlaps(2.0 * np.array(PEOPLE[0]), found).max() > 0.5
    for d in detector.detect(wide):
        assert 0.0 <= d.box_px[0] < d.box_px[2] <= 1000.0
        assert 0.0 <= d.box_px[1] < d.box_px[3] <= 480.0
    with pytest.raises(CutError, match="is needed"):
        detector.detect(rgb[:, :, 0])
    with pytest.raises(CutError, match="is needed"):
        detector.detect(rgb.astype(np.float32))


def test_another_input_size_needs_only_other_anchors(model: ModelFile, rgb: np.ndarray) -> None:
    larger = replace(model, input_px=(640, 480), anchors_px=all_anchors_px(model.levels, (640, 480)))
    logits, offsets = open_backend("opencv", larger, 1).forward(np.zeros((1, 3, 480, 640), np.float32))
    assert len(logits) == len(offsets) == len(larger.anchors_px)
    decode(larger, logits, offsets, (320, 240))
    with pytest.raises(CutError, match="cannot run it"):
        open_backend("opencv", model, 1).forward(np.zeros((1, 3, 480, 640), np.float32))


def test_invalid_thresholds_are_refused(model: ModelFile) -> None:
    with pytest.raises(OptionError, match="from 0 to 1"):
        Detector(model, threshold=1.5)
