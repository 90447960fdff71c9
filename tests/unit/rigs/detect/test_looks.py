"""Looks against drawn pictures: the object's pixels are those whose colours are rare around the box."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.locate.looks import look_difference, look_of, median_look, object_pixels  # noqa: E402

LAWN, PATH, RED, NAVY = (70, 110, 50), (170, 160, 140), (190, 40, 40), (30, 40, 90)
BOX = (40.0, 20.0, 60.0, 60.0)


def picture(shirt: tuple[int, int, int], trousers: tuple[int, int, int], *, wide: int = 6) -> np.ndarray:
    """Return a person before a lawn on the left and a path on the right; the box is 20 x 40 pixels."""
    rgb = np.full((80, 100, 3), LAWN, np.uint8)
    rgb[:, 50:] = PATH
    rgb[22:40, 50 - wide // 2 : 50 + wide // 2] = shirt
    rgb[40:58, 50 - wide // 2 : 50 + wide // 2] = trousers
    return rgb


def look(rgb: np.ndarray, box: tuple[float, float, float, float] = BOX) -> np.ndarray | None:
    return look_of(object_pixels(rgb, box), box)


def test_only_the_object_counts_although_it_fills_a_third_of_its_box() -> None:
    shown = object_pixels(picture(RED, NAVY), BOX)
    assert shown.shown.sum() == 36 * 6
    found = look(picture(RED, NAVY))
    wide = look(picture(RED, NAVY, wide=14))
    assert found == pytest.approx(wide, abs=1e-6)


def test_other_clothes_differ_more_than_shade_does() -> None:
    one = look(picture(RED, NAVY))
    shaded = look((picture(RED, NAVY) * 0.6).astype(np.uint8))
    other = look(picture(NAVY, RED))
    assert look_difference(one, one) == 0.0
    near, far = look_difference(one, shaded), look_difference(one, other)
    assert near is not None
    assert far is not None
    assert near < 0.4 * far
    assert look_difference(np.zeros(6), np.array([3.0, 0.0, 4.0, 0.0, 0.0, 1.0])) == pytest.approx((5.0 + 1.0) / 2.0)


def test_an_object_as_green_as_the_lawn_is_seen_by_the_middle_of_its_box() -> None:
    shown = object_pixels(picture(LAWN, LAWN, wide=0), BOX)
    assert shown.shown.sum() == 40 * 14  # 70 % of the width


def test_a_part_without_pixels_is_unknown_and_is_not_compared() -> None:
    found = look(picture(LAWN, NAVY))
    assert found is not None
    assert np.isnan(found[:3]).all()
    assert look_difference(found, look(picture(RED, NAVY))) == pytest.approx(0.0, abs=1e-6)
    assert look_difference(np.full(6, math.nan), found) is None
    assert look_difference(None, found) is None
    assert look(picture(RED, NAVY), (45.0, 30.0, 55.0, 38.0)) is None  # too small


def test_the_median_look_ignores_one_wrong_look_and_missing_parts() -> None:
    right, wrong, half = np.arange(6.0), np.full(6, 90.0), np.array([0.0, 1.0, 2.0, math.nan, math.nan, math.nan])
    assert median_look([right, wrong, right]) == pytest.approx(right)
    assert median_look([half, right])[:3] == pytest.approx(right[:3])
    assert median_look([half, right, wrong])[3:] == pytest.approx(0.5 * (right + wrong)[3:])
    assert np.isnan(median_look([half])[3:]).all()


def test_boxes_at_the_edges_of_a_picture_are_allowed() -> None:
    rgb = picture(RED, NAVY)
    for box in ((-5.0, -3.0, 12.0, 30.0), (90.0, 60.0, 108.0, 85.0), (0.0, 0.0, 100.0, 80.0), (50.2, 20.0, 50.4, 60.0)):
        assert object_pixels(rgb, box).shown.size > 0
