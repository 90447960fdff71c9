"""Boxes, masks and occlusion, against pictures with known answers and a slow count of pixels."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from hil.apps.dataset.formats.coco import CocoPicture, coco_parts, coco_picture
from hil.apps.dataset.formats.labels import Catalogue, LabelReader, PictureLabels, mask_texts
from hil.apps.dataset.formats.split import split_frames
from hil.apps.dataset.formats.voc import annotation_xml, image_sets
from signals.classes import Classes
from signals.errors import RecordingError

CLASSES = Classes(("none", "ground", "car", "tree"), ((0, 0, 0), (9, 9, 9), (200, 0, 0), (0, 200, 0)))
CATALOGUE = Catalogue.of(CLASSES, [(1, 1), (2, 2), (3, 2), (4, 3), (60000, 3)])
UInt16 = NDArray[np.uint16]


def labels_of(instance: UInt16, depth: NDArray[np.float32] | None = None) -> PictureLabels:
    classes = np.zeros(65536, np.uint8)
    for identity, class_id in CATALOGUE.class_of_instance.items():
        classes[identity] = class_id
    channels = {"instance": instance, "segmentation": classes[instance]}
    return LabelReader(CATALOGUE).read(channels if depth is None else {**channels, "depth": depth})


def decoded(counts: list[int], height: int, width: int) -> NDArray[np.bool_]:
    assert sum(counts) == height * width
    flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
    return flat.reshape(width, height).T


@settings(max_examples=150)
@given(st.data())
def test_boxes_and_masks_agree_with_the_pictures_pixel_for_pixel(data: st.DataObject) -> None:
    shape = (data.draw(st.integers(1, 30)), data.draw(st.integers(1, 30)))
    instance = data.draw(arrays(np.uint16, shape, elements=st.sampled_from([0, 1, 2, 3, 4, 60000])))
    labels = labels_of(instance)
    masks = [[int(n) for n in text.split(",")] for text in mask_texts(instance, labels)]
    assert [o.instance for o in labels.objects] == sorted(set(instance.ravel().tolist()) - {0, 1})
    for o, counts in zip(labels.objects, masks, strict=True):
        mask = instance == o.instance
        rows, columns = np.nonzero(mask)
        assert (o.x_min, o.y_min) == (columns.min(), rows.min())
        assert (o.x_max, o.y_max) == (columns.max(), rows.max())
        assert o.area_px == mask.sum()
        rim = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        assert o.truncated == rim.any()
        assert np.array_equal(decoded(counts, *shape), mask)
        assert all(n > 0 for n in counts[1:])
    wanted = np.bincount(labels_class(instance).ravel(), minlength=256)
    assert np.array_equal(labels.class_pixels, wanted)


def labels_class(instance: UInt16) -> NDArray[np.uint8]:
    of = np.zeros(65536, np.uint8)
    for identity, class_id in CATALOGUE.class_of_instance.items():
        of[identity] = class_id
    return of[instance]


def scene() -> tuple[UInt16, NDArray[np.float32]]:
    """Return a view along the horizon from 2 m above ground: a car 3 m wide at 10 m, a tree 4 m in front of it.

    Pinhole of 100 pixels' focal length, axis at (50, 30). Row v below the horizon sees the ground at 200 / (v - 30) m.
    """
    instance = np.zeros((60, 100), np.uint16)
    depth = np.full((60, 100), np.inf, np.float32)
    for v in range(31, 60):
        instance[v] = 1
        depth[v] = 200.0 / (v - 30.0)
    instance[25:50, 35:66], depth[25:50, 35:66] = 2, 10.0  # its foot at row 50 meets the ground
    return instance, depth


def test_an_unoccluded_object_has_no_hidden_part() -> None:
    (car,) = labels_of(*scene()).objects
    assert (car.x_min, car.y_min, car.x_max, car.y_max) == (35, 25, 65, 49)
    assert car.hidden == 0.0
    assert not car.occluded
    assert not car.truncated


def test_an_object_in_front_hides_its_share_of_the_rim() -> None:
    instance, depth = scene()
    instance[5:55, 60:64], depth[5:55, 60:64] = 4, 6.0
    car, tree = labels_of(instance, depth).objects
    # The car's rim: 27 columns above and below, 25 rows at each of four sides, two of which face the tree.
    assert car.hidden == pytest.approx(50 / (2 * 27 + 4 * 25))
    assert car.occluded
    assert tree.hidden == 0.0


def test_a_receding_wall_does_not_hide_an_object_that_touches_it() -> None:
    """Inverse depth of a plane is linear across the picture, however steep."""
    instance = np.full((20, 40), 3, np.uint16)
    u = np.arange(40)
    depth = np.broadcast_to((1.0 / (0.02 + 0.01 * u)).astype(np.float32), (20, 40)).copy()
    instance[5:15, 10:20], depth[5:15, 10:20] = 4, depth[5:15, 19:20]  # a post on the wall, facing the camera
    assert labels_of(instance, depth).objects[1].hidden == 0.0


def test_without_depth_nothing_is_hidden_and_no_rim_is_not_hidden() -> None:
    assert labels_of(np.full((3, 3), 2, np.uint16)).objects[0].hidden == 0.0


def test_refusals() -> None:
    with pytest.raises(RecordingError, match="instance 2 occurs twice"):
        Catalogue.of(CLASSES, [(2, 1), (2, 2)])
    with pytest.raises(RecordingError, match="no name"):
        Catalogue.of(CLASSES, [(2, 9)])
    with pytest.raises(RecordingError, match="shows instance 77"):
        labels_of(np.full((2, 2), 77, np.uint16))
    reader = LabelReader(CATALOGUE)
    for instance, classes, what in (
        (np.zeros((0, 4), np.uint16), np.zeros((0, 4), np.uint8), "empty"),
        (np.zeros((4, 4), np.uint16), np.zeros((4, 5), np.uint8), "differ in size"),
        (np.zeros((4, 4), np.int32), np.zeros((4, 4), np.uint8), "cannot be read"),
    ):
        with pytest.raises(RecordingError, match=what):
            reader.read({"instance": instance, "segmentation": classes})


def test_catalogue_of_a_house_with_its_door() -> None:
    catalogue = Catalogue.of_geoms(CLASSES, np.array([1, 5, 5, 5, 0], np.uint16), np.array([1, 3, 2, 2, 0], np.uint8))
    assert catalogue.class_of_instance == {1: 1, 5: 2}
    assert catalogue.object_classes == {2, 3}


@pytest.mark.parametrize(("width_px", "difficult"), [(7, "1"), (8, "0")])
def test_voc_calls_fewer_than_64_pixels_difficult(width_px: int, difficult: str) -> None:
    instance, depth = scene()
    instance[:], depth[:] = 0, 9.0
    instance[10:18, 10 : 10 + width_px] = 4
    root = ElementTree.fromstring(annotation_xml("7.png", labels_of(instance, depth), CLASSES))
    assert [o.findtext("difficult") for o in root.findall("object")] == [difficult]


def test_voc_boxes_count_from_one_and_include_the_last() -> None:
    instance, depth = scene()
    instance[5:55, 60:64], depth[5:55, 60:64] = 4, 6.0
    root = ElementTree.fromstring(annotation_xml("7.png", labels_of(instance, depth), CLASSES))
    assert root.findtext("filename") == "7.png"
    assert [root.findtext(f"size/{k}") for k in ("width", "height", "depth")] == ["100", "60", "3"]
    car, tree = root.findall("object")
    assert [car.findtext(k) for k in ("name", "truncated", "occluded", "difficult")] == ["car", "0", "1", "0"]
    assert [car.findtext(f"bndbox/{k}") for k in ("xmin", "ymin", "xmax", "ymax")] == ["36", "26", "66", "50"]
    assert tree.findtext("occluded") == "0"
    with pytest.raises(RecordingError, match="no folders"):
        annotation_xml("a/7.png", labels_of(instance), CLASSES)


def test_voc_image_sets_hold_every_frame_of_their_set() -> None:
    split = split_frames(100)
    names = [f"{i:03d}" for i in range(100)]
    sets = {name: text.split() for name, text in image_sets(names, split).items()}
    assert sorted(sets) == ["test.txt", "train.txt", "trainval.txt", "val.txt"]
    assert sets["trainval.txt"] == sorted(sets["train.txt"] + sets["val.txt"])
    assert sets["test.txt"] == [names[i] for i in split.frames("test")]
    with pytest.raises(RecordingError, match="99 pictures"):
        image_sets(names[1:], split)


def coco_file(pictures: list[CocoPicture]) -> str:
    return "".join(coco_parts(pictures, CATALOGUE, description="test", licence="CC0-1.0"))


def coco_of(frames: list[UInt16]) -> tuple[str, list[CocoPicture]]:
    pictures = []
    for i, instance in enumerate(frames):
        labels = labels_of(instance)
        pictures.append(coco_picture(i, f"{i}.png", labels, mask_texts(instance, labels), t_ns=i * 10))
    return coco_file(pictures), pictures


def test_coco_holds_what_was_seen() -> None:
    frames = [scene()[0], np.ones((60, 100), np.uint16)]
    text, _ = coco_of(frames)
    data = json.loads(text)
    assert [(i["id"], i["file_name"], i["timestamp_ns"]) for i in data["images"]] == [(1, "0.png", 0), (2, "1.png", 10)]
    assert [c["name"] for c in data["categories"]] == ["car", "tree"]
    (a,) = data["annotations"]
    assert (a["id"], a["image_id"], a["category_id"], a["iscrowd"]) == (65538, 1, 2, 0)
    assert (a["bbox"], a["area"]) == ([35, 25, 31, 25], 31 * 25)
    assert np.array_equal(decoded(a["segmentation"]["counts"], *a["segmentation"]["size"]), frames[0] == 2)


def test_coco_refusals() -> None:
    instance = scene()[0]
    labels = labels_of(instance)
    masks = mask_texts(instance, labels)
    twice = labels._replace(objects=labels.objects * 2)
    with pytest.raises(RecordingError, match="two objects of instance 2"):
        coco_picture(0, "0.png", twice, masks * 2, t_ns=0)
    with pytest.raises(RecordingError, match="1 objects, but 0 masks"):
        coco_picture(0, "0.png", labels, (), t_ns=0)
    picture = coco_picture(0, "0.png", labels, masks, t_ns=0)
    with pytest.raises(RecordingError, match="order"):
        coco_file([picture, picture])
