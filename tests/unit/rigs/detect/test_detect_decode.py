"""Decoding of hand-made outputs, descriptions of models, and invalid pictures."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.worlds.scripted_bench import CLIENT

from hil_companion.detect.model_file import Level, by_anchor  # isort: skip
from hil_companion.detect.backends import BACKENDS, open_backend  # isort: skip
from hil_companion.detect.decode import MAX_DETECTIONS, decode, overlaps  # isort: skip
from hil_companion.detect.detector import check_picture  # isort: skip
from hil_companion.detect.decode import Letterbox  # isort: skip
from hil_companion.detect.model_file import ModelFile  # isort: skip
from hil_companion.errors import CutError, OptionError  # isort: skip


assert CLIENT
NEVER = -20.0  # a logit


def description(sha256: str) -> dict[str, Any]:
    return {
        "format": 1,
        "sha256": sha256,
        "classes": ["person", "vehicle"],
        "input_px": [64, 48],
        "levels": [
            {"stride_px": 8, "sizes_px": [8.0, 16.0], "aspect_ratios": [0.5, 2.0]},
            {"stride_px": 16, "sizes_px": [32.0], "aspect_ratios": [1.0]},
        ],
        "mean": [0.5, 0.5, 0.5],
        "std": [0.25, 0.25, 0.25],
        "score_threshold": 0.5,
        "nms_iou": 0.45,
    }


def write_model(folder: Path, onnx: bytes = b"not read here", **changes: Any) -> Path:
    """Write NAME.onnx and its description with replaced keys; None leaves a key out."""
    path = folder / "small.onnx"
    path.write_bytes(onnx)
    data = {**description(hashlib.sha256(onnx).hexdigest()), **changes}
    path.with_suffix(".json").write_text(json.dumps({k: v for k, v in data.items() if v is not None}))
    return path


def silent(model: ModelFile) -> tuple[np.ndarray, np.ndarray]:
    """Return outputs without detections: logits (N, classes) and offsets (N, 4)."""
    n = len(model.anchors_px)
    return np.full((n, len(model.classes)), NEVER, np.float32), np.zeros((n, 4), np.float32)


def offsets_to(anchor: np.ndarray, box_px: tuple[float, float, float, float]) -> np.ndarray:
    """Return the offsets that turn an anchor into this box of the input: the inverse of SSD's decoding."""
    x0, y0, x1, y1 = box_px
    x, y, w, h = (float(v) for v in anchor)
    centre = ((0.5 * (x0 + x1) - x) / w / 0.1, (0.5 * (y0 + y1) - y) / h / 0.1)
    return np.array([*centre, np.log((x1 - x0) / w) / 0.2, np.log((y1 - y0) / h) / 0.2], np.float32)


@pytest.fixture
def model(tmp_path: Path) -> ModelFile:
    return ModelFile.load(write_model(tmp_path))


def test_anchors_stand_where_the_description_says(model: ModelFile) -> None:
    assert model.anchors_px.shape == (8 * 6 * 4 + 4 * 3, 4)
    np.testing.assert_allclose(model.anchors_px[0], [4, 4, 8 * 0.5**0.5, 8 / 0.5**0.5], rtol=1e-6)
    np.testing.assert_allclose(model.anchors_px[4 * 8 + 1], [4, 12, 8 * 2**0.5, 8 / 2**0.5], rtol=1e-6)
    np.testing.assert_allclose(model.anchors_px[-1], [56, 40, 32, 32])
    assert Level(16, (8.0,), (1.0,)).map_size((320, 250)) == (20, 16)  # a partial cell at the end counts


def test_a_box_comes_back_where_it_was_put(model: ModelFile) -> None:
    logits, offsets = silent(model)
    logits[77, 1] = 2.0
    offsets[77] = offsets_to(model.anchors_px[77], (10.0, 12.0, 31.5, 25.0))
    (found,) = decode(model, logits, offsets, (64, 48))
    assert found.label == "vehicle"
    assert found.score == pytest.approx(1.0 / (1.0 + np.exp(-2.0)))
    assert found.box_px == pytest.approx((10.0, 12.0, 31.5, 25.0), abs=1e-4)


@pytest.mark.parametrize("size", [(128, 96), (32, 24), (128, 48), (40, 96), (1280, 17)])
def test_boxes_of_any_picture_are_in_its_own_pixels(model: ModelFile, size: tuple[int, int]) -> None:
    w, h = size
    box = (0.25 * w, 0.25 * h, 0.5 * w, 0.75 * h)
    scale = min(64 / w, 48 / h)
    shift_x, shift_y = (64 - round(w * scale)) // 2, (48 - round(h * scale)) // 2
    put = tuple(v * scale + s for v, s in zip(box, (shift_x, shift_y) * 2, strict=True))
    logits, offsets = silent(model)
    logits[40, 0] = 3.0
    offsets[40] = offsets_to(model.anchors_px[40], put)  # type: ignore[arg-type]
    (found,) = decode(model, logits, offsets, size)
    assert found.box_px == pytest.approx(box, abs=1e-3 / scale)


def test_of_overlapping_boxes_of_one_class_the_best_stays(model: ModelFile) -> None:
    logits, offsets = silent(model)
    boxes = {10: (10, 10, 20, 30), 11: (11, 10, 21, 30), 50: (30, 10, 40, 30), 51: (35, 10, 45, 30)}
    for i, box in boxes.items():
        offsets[i] = offsets_to(model.anchors_px[i], box)
    logits[[10, 11, 50, 51], 0] = 1.0, 2.0, 4.0, 3.0  # 10 under 11: IoU 0.82; 50 and 51: 1/3
    logits[10, 1] = 0.5  # suppression is per class
    found = decode(model, logits, offsets, (64, 48))
    assert [(f.label, round(f.box_px[0])) for f in found] == [
        ("person", 30),
        ("person", 35),
        ("person", 11),
        ("vehicle", 10),
    ]


def test_equal_scores_come_in_one_order_and_many_are_cut_off(model: ModelFile) -> None:
    logits, offsets = silent(model)
    logits[:, :] = 1.0
    offsets[:, 2:] = -5.0  # so small that no two boxes of one cell overlap much
    found = decode(model, logits, offsets, (64, 48))
    assert len(found) == MAX_DETECTIONS
    assert found == decode(model, logits.copy(), offsets.copy(), (64, 48))
    assert [f.label for f in found] == ["person"] * MAX_DETECTIONS


def test_threshold_nan_and_boxes_outside(model: ModelFile) -> None:
    logits, offsets = silent(model)
    logits[0, 0] = -0.1  # a score of 0.475
    assert decode(model, logits, offsets, (64, 48)) == []
    assert len(decode(model, logits, offsets, (64, 48), threshold=0.4)) == 1
    assert len(decode(model, logits, offsets, (64, 48), threshold=0.0)) > 10
    logits[0, 0] = np.nan
    assert decode(model, logits, offsets, (64, 48)) == []
    logits[0, 0] = 5.0
    offsets[0] = np.nan
    assert decode(model, logits, offsets, (64, 48)) == []
    offsets[0] = offsets_to(model.anchors_px[0], (-30.0, -30.0, -5.0, -5.0))
    assert decode(model, logits, offsets, (64, 48)) == []
    offsets[0] = offsets_to(model.anchors_px[0], (-3.0, -4.0, 5.0, 5.0))
    assert decode(model, logits, offsets, (64, 48))[0].box_px == pytest.approx((0.0, 0.0, 5.0, 5.0), abs=1e-4)
    with pytest.raises(ValueError, match="anchors"):
        decode(model, logits[1:], offsets, (64, 48))


def test_output_maps_are_split_by_place() -> None:
    levels = (Level(8, (8.0,), (0.5, 1.0)), Level(16, (16.0,), (1.0,)))
    rng = np.random.default_rng(1)
    maps = [rng.normal(size=(1, 2 * 7, 2, 4)).astype(np.float32), rng.normal(size=(1, 7, 1, 2)).astype(np.float32)]
    logits, offsets = by_anchor(levels, (32, 16), maps, 3)
    place, shape = (1, 2), 1
    n = (place[0] * 4 + place[1]) * 2 + shape
    assert logits[n].tolist() == maps[0][0, 7:10, 1, 2].tolist()
    assert offsets[n].tolist() == maps[0][0, 10:14, 1, 2].tolist()
    assert logits[16 + 1].tolist() == maps[1][0, :3, 0, 1].tolist()
    with pytest.raises(ValueError, match="is described"):
        by_anchor(levels, (32, 16), maps[::-1], 3)
    with pytest.raises(ValueError, match="levels"):
        by_anchor(levels, (32, 16), maps[:1], 3)


def test_overlap_is_area_in_common_over_area_of_both() -> None:
    others = np.array([[0, 0, 2, 2], [1, 0, 3, 2], [5, 5, 6, 6], [0, 0, 0, 0]], float)
    assert overlaps(others[0], others).tolist() == [1.0, 1 / 3, 0.0, 0.0]


def test_a_picture_of_another_shape_is_not_stretched() -> None:
    out = np.zeros((48, 64, 3), np.uint8)
    fit = Letterbox.of((32, 96), (64, 48))
    assert (fit.scale, fit.shift_x_px, fit.shift_y_px, fit.placed_px) == (0.5, 24, 0, (16, 48))
    fit.place(np.full((96, 32, 3), 200, np.uint8), out)
    assert (out[:, 24:40] == 200).all()
    assert (out[:, :24] == 114).all()
    assert fit.back(np.array([[24.0, 0.0, 40.0, 48.0]])).tolist() == [[0.0, 0.0, 32.0, 96.0]]


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (np.zeros((48, 64), np.uint8), "is needed"),
        (np.zeros((48, 64, 4), np.uint8), "is needed"),
        (np.zeros((48, 64, 3), np.float32), "uint8"),
        (np.zeros((0, 64, 3), np.uint8), "8 to 16384"),
        (np.zeros((48, 4, 3), np.uint8), "4 x 48"),
        (None, "is needed"),
    ],
)
def test_invalid_pictures_are_refused(picture: Any, words: str) -> None:
    with pytest.raises(CutError, match=words):
        check_picture(picture)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"classes": None}, "'classes' is missing"),
        ({"classes": []}, "names are needed"),
        ({"classes": ["a", "a"]}, "each once"),
        ({"format": 2}, "reads 1"),
        ({"input_px": [320]}, "not a description"),
        ({"input_px": [320, 8]}, "from 16"),
        ({"levels": []}, "above 0"),
        ({"levels": [{"stride_px": 8, "sizes_px": [], "aspect_ratios": [1]}]}, "above 0"),
        ({"std": [1, 1, 0]}, "std above 0"),
        ({"score_threshold": 3}, "between 0 and 1"),
        ({"score_threshold": "much"}, "not a description"),
        ({"sha256": "0" * 64}, "another model"),
        ({"sha256": None}, "'sha256' is missing"),
    ],
)
def test_invalid_descriptions_are_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        ModelFile.load(write_model(tmp_path, **changes))


def test_missing_and_broken_files(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"nothing\.onnx: cannot be read"):
        ModelFile.load(tmp_path / "nothing.onnx")
    with pytest.raises(OptionError, match=r"a \.onnx file"):
        ModelFile.load(tmp_path / "weights.pt")
    path = write_model(tmp_path)
    path.with_suffix(".json").write_text("{")
    with pytest.raises(OptionError, match="is not JSON"):
        ModelFile.load(path)
    path.with_suffix(".json").write_text("[]")
    with pytest.raises(OptionError, match="not a description"):
        ModelFile.load(path)
    path.with_suffix(".json").unlink()
    with pytest.raises(OptionError, match=r"small\.json: cannot be read"):
        ModelFile.load(path)


def test_a_description_says_what_was_read(model: ModelFile, tmp_path: Path) -> None:
    again = tmp_path / "again"
    again.mkdir()
    assert ModelFile.load(write_model(again, **model.description())).description() == model.description()


def test_back_ends_that_are_not_there_or_read_nonsense(model: ModelFile) -> None:
    with pytest.raises(OptionError, match="there are opencv, onnxruntime, pytorch"):
        open_backend("tensorflow", model)
    with pytest.raises(OptionError, match="at least 1"):
        open_backend("opencv", model, 0)


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_a_back_end_refuses_a_file_that_is_no_network(model: ModelFile, backend: str) -> None:
    pytest.importorskip(f"hil_companion.detect.backends.{BACKENDS[backend][0]}")
    with pytest.raises(OptionError, match="cannot read it"):
        open_backend(backend, model)


def test_pytorch_names_an_operator_that_it_does_not_know(model: ModelFile) -> None:
    pytest.importorskip("torch")
    onnx = pytest.importorskip("onnx")
    graph = onnx.helper.make_graph([onnx.helper.make_node("Softmax", ["x"], ["level0"])], "net", [], [])
    model.path.write_bytes(onnx.helper.make_model(graph).SerializeToString())
    with pytest.raises(OptionError, match=r"operator Softmax; detectors of .* have Conv, Relu, Add"):
        open_backend("pytorch", model)
