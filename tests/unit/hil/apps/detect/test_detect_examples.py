"""Training examples: boxes follow the objects through augmentation, and each object gets anchors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable
from tests.worlds.labelled_pictures import some_objects, write_data_set

make_client_importable()
from hil_companion.detect.decode import overlaps  # noqa: E402

from hil.apps.detect.picture_store import PictureStore  # noqa: E402
from hil.apps.detect.pictures import read_data_sets  # noqa: E402
from hil.apps.detect.training.assign import BACKGROUND, Assigner, ignored  # noqa: E402
from hil.apps.detect.training.augment import Augmenter, Strength  # noqa: E402
from hil.apps.detect.training.layout import INPUT_PX, LEVELS  # noqa: E402

CLASSES = ("person", "vehicle")
NO_LIGHT = {"brightness": 0.0, "contrast": 0.0, "saturation": 0.0, "hue": 0.0, "noise_share": 0.0, "blur_share": 0.0}


@pytest.fixture
def store(tmp_path: Path) -> PictureStore:
    rng = np.random.default_rng(3)
    folder = write_data_set(tmp_path / "set", [some_objects(rng) for _ in range(8)])
    return PictureStore(read_data_sets([folder]), INPUT_PX)


@pytest.mark.parametrize("mosaic", [0.0, 1.0])
def test_boxes_follow_the_pixels(store: PictureStore, mosaic: float) -> None:
    """Only objects have strongly coloured pixels: nearly all pixels inside a box, none outside all boxes."""
    augmenter = Augmenter(store, CLASSES, 5, Strength(mosaic_share=mosaic, **NO_LIGHT))  # type: ignore[arg-type]
    for index in range(8):
        e = augmenter.example(index, 2)
        red, blue = (e.rgb[:, :, 0] > 180) & (e.rgb[:, :, 2] < 90), (e.rgb[:, :, 2] > 180) & (e.rgb[:, :, 0] < 90)
        covered = np.zeros(red.shape, bool)
        for (x0, y0, x1, y1), number in zip(e.boxes_px, e.classes, strict=True):
            own = red if CLASSES[number] == "person" else blue
            a, b, c, d = int(np.floor(y0)), int(np.ceil(y1)), int(np.floor(x0)), int(np.ceil(x1))
            covered[a:b, c:d] = True
            inside = own[a + 2 : max(a + 2, b - 2), c + 2 : max(c + 2, d - 2)]
            assert inside.size == 0 or inside.mean() > 0.9
        assert not ((red | blue) & ~covered).sum() > 12  # cut off entirely


def test_a_picture_is_the_same_for_its_numbers_and_another_for_others(store: PictureStore) -> None:
    augmenter = Augmenter(store, CLASSES, 5, Strength())
    first = augmenter.example(0, 0)
    again = Augmenter(store, CLASSES, 5, Strength()).example(0, 0)
    assert np.array_equal(first.rgb, again.rgb)
    assert np.array_equal(first.boxes_px, again.boxes_px)
    for other in (augmenter.example(0, 1), Augmenter(store, CLASSES, 6, Strength()).example(0, 0)):
        assert not np.array_equal(first.rgb, other.rgb)
    assert np.array_equal(Augmenter(store, CLASSES, 5, None).example(0, 0).rgb, store.rgb(0))


def test_some_examples_show_nothing(store: PictureStore) -> None:
    """Plain examples have one colour or a gradient from edge to edge; the others are as without them."""
    plain = Strength(plain_share=1.0, noise_share=0.0, blur_share=0.0)
    examples = [Augmenter(store, CLASSES, 5, plain).example(i, k) for i in range(8) for k in range(8)]
    assert not any(len(e.boxes_px) or len(e.classes) or len(e.area_px) for e in examples)
    assert {e.rgb.shape for e in examples} == {store.rgb(0).shape}
    spread = np.array([np.ptp(e.rgb.astype(float).mean(axis=2)) for e in examples])
    assert 0.2 < (spread < 1.0).mean() < 0.8  # one colour
    mean = np.array([e.rgb.mean() for e in examples])
    assert mean.min() < 60.0
    assert mean.max() > 190.0
    assert max(np.abs(np.diff(e.rgb.astype(int), axis=a)).max() for e in examples for a in (0, 1)) <= 4
    few, none = (Augmenter(store, CLASSES, 5, Strength(plain_share=share)) for share in (0.1, 0.0))
    same = [np.array_equal(few.example(i, k).rgb, none.example(i, k).rgb) for i in range(8) for k in range(20)]
    assert 0.8 < np.mean(same) < 0.97


def test_small_objects_count_when_drawn_larger(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", [[("person", (150, 110, 5, 7))]])
    store = PictureStore(read_data_sets([folder]), INPUT_PX)
    assert Augmenter(store, CLASSES, 1, None).example(0, 0).difficult.tolist() == [True]
    near = Augmenter(store, CLASSES, 1, Strength(zoom=(2.0, 2.0), stretch=0.0, mosaic_share=0.0))
    seen = [e for e in (near.example(0, k) for k in range(6)) if len(e.boxes_px)]
    assert seen
    assert not any(e.difficult[0] for e in seen if e.area_px[0] > 100.0)


def test_training_looks_for_more_than_is_judged_but_not_for_blots(tmp_path: Path) -> None:
    smaller, blot = ("person", (50, 110, 6, 9)), ("person", (150, 110, 4, 4))
    store = PictureStore(read_data_sets([write_data_set(tmp_path / "set", [[smaller, blot]])]), INPUT_PX)
    assert store.pictures[0].difficult.tolist() == [True, True]  # neither is judged
    assert Augmenter(store, CLASSES, 1, None).example(0, 0).difficult.tolist() == [False, True]
    near = Augmenter(store, CLASSES, 1, Strength(zoom=(2.2, 2.2), stretch=0.0, mosaic_share=0.0))
    for e in (near.example(0, k) for k in range(8)):
        small = (e.boxes_px[:, 2] - e.boxes_px[:, 0]) * (e.boxes_px[:, 3] - e.boxes_px[:, 1]) < 90.0
        assert e.difficult[small].all(), "however large it is drawn"


def test_other_classes_are_background(store: PictureStore) -> None:
    e = Augmenter(store, ("vehicle",), 1, None).example(0, 0)
    wanted = [name == "vehicle" for name in store.pictures[0].labels]
    assert e.boxes_px.tolist() == store.boxes_px(0)[wanted].tolist()
    assert set(e.classes.tolist()) <= {0}


def test_every_object_has_anchors_that_overlap_it_and_none_has_another_s() -> None:
    assigner = Assigner(LEVELS, INPUT_PX)
    rng = np.random.default_rng(4)
    for _ in range(20):
        size = np.exp(rng.uniform(np.log(6.0), np.log(200.0), (6, 2)))
        # Middles apart from one another; the boxes may well overlap.
        middle = (np.indices((3, 2)).reshape(2, -1).T + rng.uniform(0.4, 0.6, (6, 2))) * (320 / 3, 240 / 2)
        boxes = np.concatenate([middle - size / 2, middle + size / 2], axis=1)
        boxes = np.clip(boxes, 0.0, (*INPUT_PX, *INPUT_PX)).astype(np.float32)
        classes = np.arange(6)
        found, target = assigner.targets(boxes, classes, np.zeros(6, bool))
        assert set(classes.tolist()) <= set(found.tolist())
        for anchor in np.flatnonzero(found >= 0):
            assert target[anchor].tolist() == boxes[found[anchor]].tolist()
        for i in classes:  # among its anchors is the one that overlaps it best of all
            half = 0.5 * assigner.anchors_px[:, 2:]
            corners = np.concatenate([assigner.anchors_px[:, :2] - half, assigner.anchors_px[:, :2] + half], axis=1)
            assert overlaps(boxes[i], corners[found == i]).max() > 0.1


def test_candidates_are_the_nearest_places_of_each_level() -> None:
    assigner = Assigner(LEVELS, INPUT_PX)
    rng = np.random.Generator(np.random.Philox(key=3))
    middle = np.concatenate(
        [rng.random((60, 2)) * INPUT_PX, [[0.0, 0.0], [319.9, 239.9], [0.0, 120.0], [160.0, 120.0]]]
    )
    candidates = assigner._candidates(np.tile(middle, 2).astype(np.float32))
    first = 0
    for level in LEVELS:
        anchors = level.anchors_px(INPUT_PX)
        away = np.hypot(*(anchors[None, :: level.anchors_per_position, :2] - middle[:, None]).transpose(2, 0, 1))
        nearest = np.sort(away, axis=1)[:, :9]
        for row, expected, all_away in zip(candidates, nearest, away, strict=True):
            own = row[(row >= first) & (row < first + len(anchors))] - first
            places = np.unique(own // level.anchors_per_position)
            assert len(own) == len(places) * level.anchors_per_position  # every shape at them
            np.testing.assert_allclose(np.sort(all_away[places]), expected, atol=1e-3)
        first += len(anchors)


def test_an_object_in_front_of_a_larger_one_keeps_its_anchors() -> None:
    assigner = Assigner(LEVELS, INPUT_PX)
    boxes = np.array([[100, 60, 220, 180], [155, 100, 167, 130], [150, 110, 156, 128]], np.float32)
    found, _ = assigner.targets(boxes, np.arange(3), np.zeros(3, bool))
    assert {0, 1, 2} <= set(found.tolist())


def test_difficult_objects_are_ignored() -> None:
    assigner = Assigner(LEVELS, INPUT_PX)
    boxes = np.array([[10, 10, 24, 44], [200, 100, 244, 122]], np.float32)
    found, _ = assigner.targets(boxes, np.array([0, 1]), np.array([True, False]))
    assert set(found.tolist()) == {BACKGROUND, ignored(0), 1}
    none, target = assigner.targets(boxes[:0], np.zeros(0, np.int64), np.zeros(0, bool))
    assert (none == BACKGROUND).all()
    assert not target.any()
