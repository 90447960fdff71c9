"""Labelled pictures as they are read, and every way in which labels can be broken."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hil.apps.detect.pictures import class_counts, read_data_sets
from hil.config.companion.clients import make_client_importable
from signals.errors import ConfigError
from tests.worlds.labelled_pictures import coco, write_coco, write_data_set

make_client_importable()
from hil.apps.detect.picture_store import PictureStore, digest, read_rgb  # noqa: E402

FRAMES = [
    [("person", (10, 20, 14, 34)), ("vehicle", (100, 50, 44, 22))],
    [("person", (30, 30, 6, 10))],  # 60 pixels: difficult
    [],
    [("vehicle", (200, 100, 44, 22))],
    [("person", (5, 5, 14, 34))],
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_data_set(tmp_path / "set", FRAMES)  # type: ignore[arg-type]


@pytest.mark.parametrize("voc", [False, True])
def test_both_kinds_of_labels_say_the_same(folder: Path, voc: bool) -> None:
    if voc:
        shutil.rmtree(folder / "annotations")
    pictures = read_data_sets([folder])
    assert [p.labels for p in pictures] == [tuple(n for n, _ in objects) for objects in FRAMES]
    assert pictures[0].boxes_px.tolist() == [[10, 20, 24, 54], [100, 50, 144, 72]]
    assert pictures[1].difficult.tolist() == [True]
    assert pictures[1].area_px[0] < 64.0
    assert class_counts(pictures) == {"person": 2, "vehicle": 2}


@pytest.mark.parametrize("lists", [False, True])
def test_the_three_sets_are_those_of_the_split(folder: Path, lists: bool) -> None:
    if lists:  # Pascal VOC's own
        (folder / "split.csv").unlink()
        (folder / "ImageSets/Main").mkdir(parents=True)
        for name, stems in (("train", "1000\n1001\n1002\n"), ("val", "1003\n"), ("test", "1004\n")):
            (folder / f"ImageSets/Main/{name}.txt").write_text(stems)
    parts = {part: [p.path.stem for p in read_data_sets([folder], part)] for part in ("train", "validation", "test")}
    assert parts == {"train": ["1000", "1001", "1002"], "validation": ["1003"], "test": ["1004"]}


def test_several_data_sets_are_one(folder: Path, tmp_path: Path) -> None:
    other = write_data_set(tmp_path / "other", FRAMES[:1])  # type: ignore[arg-type]
    assert len(read_data_sets([folder, other])) == 6


def test_the_digest_is_of_pixels_and_labels_and_not_of_files(folder: Path) -> None:
    pictures = read_data_sets([folder])
    named = digest(pictures)
    file = pictures[0].path
    pixels = cv2.imread(str(file))
    cv2.imwrite(str(file), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert digest(pictures) == named
    assert digest(pictures[::-1]) != named
    first = replace(pictures[0], labels=("somebody else", *pictures[0].labels[1:]))
    assert digest([first, *pictures[1:]]) != named
    pixels[3, 5, 1] ^= 1
    cv2.imwrite(str(file), pixels)
    assert digest(pictures) != named


def _coco(change: Callable[[dict[str, Any]], None]) -> Callable[[Path], None]:
    def broken(folder: Path) -> None:
        data = coco(folder)
        change(data)
        write_coco(folder, data)

    return broken


def _no_labels(folder: Path) -> None:
    shutil.rmtree(folder / "annotations")
    shutil.rmtree(folder / "Annotations")


def _broken_xml(folder: Path) -> None:
    shutil.rmtree(folder / "annotations")
    (folder / "Annotations/1000.xml").write_text("<annotation>")
    (folder / "Annotations/1001.xml").write_text("<annotation><filename>1001.png</filename></annotation>")


BROKEN: dict[str, tuple[Callable[[Path], None], list[str]]] = {
    "negative box": (_coco(lambda d: d["annotations"][0].update(bbox=[10, 20, -4, 5])), ["image 1", "person", "empty"]),
    "box outside": (_coco(lambda d: d["annotations"][0].update(bbox=[310, 20, 30, 5])), ["not in the picture"]),
    "box not a number": (_coco(lambda d: d["annotations"][0].update(bbox=[float("nan"), 2, 3, 5])), ["empty or not"]),
    "box of three": (_coco(lambda d: d["annotations"][0].update(bbox=[1, 2, 3])), ["not a COCO file"]),
    "unknown category": (_coco(lambda d: d["annotations"][0].update(category_id=77)), ["no category 77"]),
    "unknown image": (_coco(lambda d: d["annotations"][0].update(image_id=77)), ["no image 77"]),
    "no categories": (_coco(lambda d: d.pop("categories")), ["not a COCO file", "categories"]),
    "no JSON": (lambda f: (f / "annotations/instances_all.json").write_text("{") and None, ["not a COCO file"]),
    "no pictures": (_coco(lambda d: d.update(images=[], annotations=[])), ["holds no pictures"]),
    "missing file": (lambda f: (f / "mav0/cam0/data/1002.png").unlink(), ["1002.png is not there"]),
    "no labels": (_no_labels, ["holds neither"]),
    "broken xml": (_broken_xml, ["1000.xml", "1001.xml: is not a VOC annotation (no size/width)"]),
    "no folder": (lambda f: shutil.rmtree(f), ["there is no such folder"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_labels_are_reported_with_their_place(folder: Path, name: str) -> None:
    break_it, words = BROKEN[name]
    break_it(folder)
    with pytest.raises(ConfigError) as caught:
        read_data_sets([folder])
    for word in words:
        assert word in str(caught.value)
    assert str(folder) in str(caught.value)


def test_a_split_that_is_none(folder: Path) -> None:
    (folder / "split.csv").write_text("frame;set\n")
    with pytest.raises(ConfigError, match="not a table"):
        read_data_sets([folder], "train")
    (folder / "split.csv").unlink()
    with pytest.raises(ConfigError, match="--part all"):
        read_data_sets([folder], "train")
    with pytest.raises(ConfigError, match="there are train"):
        read_data_sets([folder], "training")


def test_an_empty_part_and_classes_unknown(folder: Path) -> None:
    (folder / "split.csv").write_text("0,train\n")
    with pytest.raises(ConfigError, match="no pictures in the set 'test'"):
        read_data_sets([folder], "test")
    with pytest.raises(ConfigError, match="classes unknown here: vehicle"):
        read_data_sets([folder], classes=("person",))


def test_hundreds_of_problems_do_not_fill_the_screen(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", [[("person", (10, 20, 14, 34))]] * 40)  # type: ignore[list-item]
    data = coco(folder)
    for a in data["annotations"]:
        a["bbox"] = [0, 0, 0, 0]
    write_coco(folder, data)
    with pytest.raises(ConfigError) as caught:
        read_data_sets([folder])
    assert len(caught.value.problems) == 21
    assert "20 more" in str(caught.value.problems[-1])


def test_files_that_are_no_pictures_or_of_another_size(folder: Path) -> None:
    first, second = read_data_sets([folder])[:2]
    first.path.write_bytes(b"no picture")
    with pytest.raises(ConfigError, match="cannot be read as a picture"):
        read_rgb(first)
    shutil.copy(second.path, first.path)
    assert read_rgb(first).shape == (240, 320, 3)
    data = coco(folder)
    data["images"][0].update(width=640, height=480)
    write_coco(folder, data)
    with pytest.raises(ConfigError, match="320 x 240 pixels, its labels are of 640 x 480"):
        read_rgb(read_data_sets([folder])[0])


@pytest.mark.parametrize("cache_bytes", [0, 1 << 30])
def test_pictures_of_another_size_come_with_their_boxes(folder: Path, cache_bytes: int) -> None:
    pictures = read_data_sets([folder])
    store = PictureStore(pictures, (160, 160), cache_bytes=cache_bytes)
    for _ in range(2):
        x0, y0, x1, y1 = store.boxes_px(0)[0].tolist()
        assert (x0, y0, x1, y1) == (5.0, 30.0, 12.0, 47.0)
        inside = store.rgb(0)[int(y0) + 1 : int(y1) - 1, int(x0) + 1 : int(x1) - 1]
        assert (np.abs(inside.astype(int) - (220, 30, 60)) < 3).all()
    assert store.area_px(0)[0] == pytest.approx(14 * 34 / 4)
