"""Matching, recall, average precision and false boxes of `hil bench realism`, on cases counted by hand."""

from __future__ import annotations

import math

import pytest

from lab.realism.frames import Truth
from lab.realism.kinds import BY_NAME, KINDS, group_labels, kind_of
from lab.realism.matching import DUPLICATE, FALSE, IGNORED, RIGHT, SMALL, Tally, match_group
from lab.realism.networks import Found

CAR, BUS, PERSON = BY_NAME["vehicle"], BY_NAME["bus"], BY_NAME["person"]


def truth(x: float, kind=CAR, *, share: float = 1.0, side: float = 100.0) -> Truth:
    return Truth(kind, f"{kind.name}_{x:.0f}", (x, 0.0, x + side, side), share)


def found(x: float, score: float, label: str = "car", side: float = 100.0) -> Found:
    return Found(label, score, (x, 0.0, x + side, side))


def outcomes(truths: list[Truth], boxes: list[Found], group: str = "vehicle") -> list[int]:
    return [match.outcome for match in match_group(truths, boxes, group)]


def tally_of(truths: list[Truth], boxes: list[Found], kind=CAR, threshold: float = 0.25) -> Tally:
    tally = Tally(threshold, kind)
    tally.add(0, truths, match_group(truths, boxes, kind.group))
    return tally


def test_a_box_is_right_from_an_iou_of_one_half() -> None:
    # Two equal squares of side a, moved by d: IoU = (a - d) / (a + d), which is 1/2 at d = a/3.
    assert outcomes([truth(0.0)], [found(33.0, 0.9)]) == [RIGHT]
    assert outcomes([truth(0.0)], [found(34.0, 0.9)]) == [FALSE]


def test_the_better_of_two_boxes_has_the_object() -> None:
    # IoU of the boxes with each other: 40 / 160.
    boxes = [found(-30.0, 0.6), found(30.0, 0.8)]
    assert outcomes([truth(0.0)], boxes) == [RIGHT, DUPLICATE]
    assert match_group([truth(0.0)], boxes, "vehicle")[0].found.score == 0.8
    tally = tally_of([truth(0.0)], boxes)
    assert (tally.found, tally.false_boxes) == (1, 0)


def test_boxes_smaller_than_any_object_that_counts_are_counted_apart() -> None:
    # Objects count from 40 px on their longer side; so do false boxes.
    boxes = [found(200.0, 0.9, side=39.0), found(300.0, 0.8, side=40.0), found(400.0, 0.2, side=30.0)]
    assert outcomes([truth(0.0)], boxes) == [SMALL, FALSE, SMALL]
    tally = tally_of([truth(0.0)], boxes)
    assert (tally.false_boxes, tally.small_false_boxes) == (1, 1)  # the third is below the threshold
    assert tally.small_false_per_frame == 1.0
    # A small box that finds an object is right.
    assert outcomes([truth(0.0, side=44.0)], [found(0.0, 0.9, side=39.0)]) == [RIGHT]


def test_of_overlapping_boxes_of_a_group_the_best_counts() -> None:
    assert outcomes([truth(0.0)], [found(0.0, 0.6), found(5.0, 0.8, "truck")]) == [RIGHT]


def test_boxes_on_hidden_or_small_objects_are_ignored() -> None:
    assert outcomes([truth(0.0, share=0.59)], [found(0.0, 0.9)]) == [IGNORED]
    assert outcomes([truth(0.0, side=39.0)], [found(0.0, 0.9, side=39.0)]) == [IGNORED]
    # Half of the box on the hidden object, with an IoU below 0.5.
    assert outcomes([truth(0.0, share=0.1)], [found(0.0, 0.9, side=50.0)]) == [IGNORED]
    assert outcomes([truth(0.0, share=0.1)], [found(60.0, 0.9)]) == [FALSE]


def test_only_labels_of_the_group_count() -> None:
    assert outcomes([truth(0.0)], [found(0.0, 0.9, "person")]) == []
    assert outcomes([truth(0.0)], [found(0.0, 0.9, "car"), found(300.0, 0.8, "vehicle")]) == [RIGHT, FALSE]


def test_recall_false_boxes_and_average_precision() -> None:
    truths = [truth(0.0), truth(200.0), truth(400.0), truth(600.0, PERSON)]
    boxes = [found(0.0, 0.9), found(900.0, 0.8), found(200.0, 0.7), found(400.0, 0.2), found(600.0, 0.9, "person")]
    tally = tally_of(truths, boxes)
    assert (tally.objects, tally.found, tally.false_boxes) == (3, 2, 1)  # the third box is below the threshold
    # Right, false, right, right: the precision at recalls 1/3, 2/3 and 1 is 1, 3/4 and 3/4 (greatest at or above).
    assert tally.average_precision == pytest.approx((1.0 + 0.75 + 0.75) / 3.0)
    assert tally.missed == [(0, 2)]
    assert tally.sizes[(80.0, 160.0)] == [2, 3]


def test_a_bus_called_a_car_is_found_but_not_under_its_own_label() -> None:
    truths = [truth(0.0, BUS), truth(300.0)]
    boxes = [found(0.0, 0.9, "car"), found(300.0, 0.9, "car")]
    bus = tally_of(truths, boxes, BUS)
    assert (bus.found, bus.named, bus.false_boxes) == (1, 0, 0)
    car = tally_of(truths, boxes, CAR)
    assert (car.objects, car.found, car.named, car.false_boxes) == (1, 1, 1, 0)


def test_without_objects_there_is_no_recall() -> None:
    tally = tally_of([], [found(0.0, 0.9)])
    assert math.isnan(tally.recall)
    assert math.isnan(tally.average_precision)
    assert tally.false_per_frame == 1.0


def test_objects_are_known_by_name_before_class() -> None:
    assert kind_of("bus_003", "vehicle") is BUS
    assert kind_of("car_003", "vehicle") is CAR
    assert kind_of("vehicle_000", "vehicle") is CAR
    assert kind_of("business_0", "building") is None
    assert kind_of("walker", "person") is PERSON


def test_every_label_is_one_that_a_network_knows() -> None:
    open_images = {"bicycle", "car", "dog", "person", "vehicle"}  # of the SSD's label map, what scenes hold
    assert {label for kind in KINDS for label in kind.labels} == open_images
    assert group_labels("vehicle") == {"car", "vehicle"}
