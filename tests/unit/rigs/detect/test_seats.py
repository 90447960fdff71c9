"""Seats against drawn pictures: an empty seat is no person, and two boxes on one person are one object."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.detect.decode import Detection  # noqa: E402
from hil_companion.locate.existence import sighting_evidence  # noqa: E402
from hil_companion.locate.looks import object_pixels  # noqa: E402
from hil_companion.locate.objects import Objects  # noqa: E402
from hil_companion.locate.seats import SEATED_GAIN, Seats, seated_gain  # noqa: E402
from hil_companion.locate.tracks import Sighting, Tracks  # noqa: E402

LAWN, WOOD, SHIRT = (70, 110, 50), (150, 100, 60), (40, 60, 160)
BOX = (40.0, 20.0, 60.0, 60.0)
SEAT, PERSON = Detection("bench", BOX, 0.7), Detection("person", BOX, 0.5)


def bench(sitter_px: int) -> np.ndarray:
    """Return a bench 14 pixels wide on a lawn, and on it somebody of this width."""
    rgb = np.full((80, 100, 3), LAWN, np.uint8)
    rgb[20:60, 43:57] = WOOD
    rgb[20:60, 43 : 43 + sitter_px] = SHIRT
    return rgb


@pytest.mark.parametrize("sitter_px", [0, 4, 7])
def test_the_pixels_of_a_box_that_are_not_the_seats_are_counted(sitter_px: int) -> None:
    seats = Seats()
    for _ in range(9):
        seats.learn(bench(0), [SEAT, Detection("house", BOX, 0.9)])
    share = seats.other_share(PERSON, object_pixels(bench(sitter_px), BOX), [SEAT])
    assert share == pytest.approx(sitter_px / 14)
    assert seated_gain(share) == (SEATED_GAIN if sitter_px == 7 else 0.0)


def test_light_does_not_change_the_colour_of_a_seat() -> None:
    seats = Seats()
    seats.learn(bench(0), [SEAT])
    shade = (bench(7) * 0.7).astype(np.uint8)
    assert seats.other_share(PERSON, object_pixels(shade, BOX), [SEAT]) == pytest.approx(0.5)


def test_a_box_beside_a_seat_is_not_on_it() -> None:
    seats, pixels = Seats(), object_pixels(bench(7), BOX)
    seats.learn(bench(0), [SEAT])
    beside = Detection("bench", (57.0, 20.0, 90.0, 60.0), 0.7)
    assert seats.other_share(PERSON, pixels, [beside]) is None
    assert seats.other_share(PERSON, pixels, [Detection("bin", BOX, 0.7)]) is None
    assert seated_gain(None) == 0.0


def test_an_empty_seat_is_evidence_against_a_person() -> None:
    without = sighting_evidence(0.04, 1.65)
    assert sighting_evidence(0.04, 1.65, 0.35) == pytest.approx(without)
    assert sighting_evidence(0.04, 1.65, 0.0) == pytest.approx(without - 0.35 * 1.8)
    assert sighting_evidence(0.04, 1.65, 0.9) == pytest.approx(without + 0.35 * 1.0)


@pytest.mark.parametrize(("apart_m", "people"), [(1.2, 1), (2.0, 2)])
def test_two_boxes_on_one_still_person_are_one_object(apart_m: float, people: int) -> None:
    tracks = Tracks()
    for k in range(20):
        boxes = [
            Sighting("person", (x, 0.0, 0.9), np.eye(2) * 0.01, evidence=evidence)
            for x, evidence in ((0.0, 1.0), (apart_m, 0.7))
        ]
        tracks.add(k * 500_000_000, boxes)
    found = Objects(least=3).found(tracks.tracks)
    assert len(found) == people
    assert math.hypot(*found[0].p_W[:2]) < 0.1  # the one with more evidence
