"""Streaks of rain and flakes of snow: how much they cover, where they point, and what they leave alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sim._kernels import draw_streaks
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.rain_streaks import RainStreaks
from sim.scene.precipitation import rain, snow

CAMERA = CameraModel.from_fov(320, 240, 90.0)
LEVEL = (0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0)  # along x of W, right along -y, down along -z
STILL = CameraPose((0.0, 0.0, 5.0), LEVEL)


def streaks(falling: Any = None, exposure_s: float = 0.008, **options: Any) -> RainStreaks:
    options = {"wind_W_mps": (0.0, 0.0, 0.0), "key": (1, 2)} | options
    return RainStreaks(falling or rain(30.0), CAMERA, exposure_s=exposure_s, **options)


def one_drop(*, width_m: float = 0.004, z_m: float = 2.0, fall_mps: float = 0.0, **changed: Any) -> Any:
    """Opacity of 400 drops at one range in a picture so wide that few lie at its edge."""
    opacity = np.zeros((1000, 1000), np.float32)
    told: dict[str, Any] = {
        "intrinsics_px": (300.0, 300.0, 500.0, 500.0),
        "share": np.ones(1),
        "width_m": np.array([width_m]),
        "far_m": np.array([z_m]),
        "fall_mps": np.array([fall_mps]),
        "near_m_and_margin_px": (z_m, 0.0),
        "air_C_mps": (0.0, 0.0, 0.0),
        "down_C": (0.0, 1.0, 0.0),
        "exposure_s": 0.01,
        "key": (3, 4),
        "index": 0,
        "count": 400,
    }
    draw_streaks(opacity, **told | changed)
    return opacity


@pytest.mark.parametrize("fall_mps", [0.0, 8.0])
@pytest.mark.parametrize("width_m", [0.002, 0.02])
def test_a_drop_covers_its_area_however_far_it_moves(width_m: float, fall_mps: float) -> None:
    opacity = one_drop(width_m=width_m, fall_mps=fall_mps)
    wide_px = 300.0 * width_m / 2.0
    assert float(opacity.sum(dtype=np.float64)) == pytest.approx(400 * 0.25 * math.pi * wide_px**2, rel=0.03)


def test_a_streak_is_as_long_as_the_drop_moves() -> None:
    moved_px = 300.0 * 8.0 * 0.01 / 2.0
    opacity = one_drop(fall_mps=8.0, count=1)
    rows, columns = np.nonzero(opacity)
    assert np.ptp(rows) == pytest.approx(moved_px, abs=2.0)
    assert np.ptp(columns) <= 2


def test_a_drop_at_rest_is_a_disc() -> None:
    opacity = one_drop(width_m=0.2, count=1, index=1)  # 30 pixels wide, away from the edge
    rows, columns = np.nonzero(opacity > 0.5)
    assert np.ptp(rows) == pytest.approx(30, abs=2)
    assert np.ptp(columns) == pytest.approx(30, abs=2)
    assert len(rows) == pytest.approx(0.25 * math.pi * 30**2, rel=0.1)


def test_wind_slants_streaks_and_flight_draws_them_out_of_the_point_flown_to() -> None:
    slanted = one_drop(fall_mps=8.0, count=1, air_C_mps=(8.0, 0.0, 0.0))
    rows, columns = np.nonzero(slanted)
    assert np.ptp(rows) == pytest.approx(np.ptp(columns), abs=2)
    ahead = one_drop(count=1, air_C_mps=(0.0, 0.0, -20.0))
    rows, columns = np.nonzero(ahead)
    along = np.array([np.ptp(columns), np.ptp(rows)], float)
    outward = np.abs([columns.mean() - 500.0, rows.mean() - 500.0])
    assert along / np.linalg.norm(along) == pytest.approx(outward / np.linalg.norm(outward), abs=0.1)


def test_drops_are_as_many_as_the_air_holds() -> None:
    """The integral over widths and ranges at which a drop adds 0.004 to a pixel, by brute force."""
    falling, made = rain(30.0), streaks()
    widths_mm = np.linspace(0.0, 6.0, 4001)[1:]
    total = 0.0
    for width in widths_mm:
        density = falling.n0_per_m3_mm * math.exp(-falling.slope_per_mm * width) * (widths_mm[1] - widths_mm[0])
        z = np.linspace(0.2, 40.0, 4000)
        wide_px = 160.0 * 1e-3 * width / z
        length_px = np.maximum(160.0 * falling.fall_mps(float(width)) * 0.008 / z, 1.0)
        shown = 0.25 * math.pi * wide_px**2 / length_px >= 0.004
        total += density * float(np.sum(z**2 * shown)) * (z[1] - z[0])
    area_px = (320 + 2 * made._margin_px) * (240 + 2 * made._margin_px) / 160.0**2
    assert made.mean_count == pytest.approx(total * area_px, rel=0.05)


def test_a_short_exposure_shows_more_of_the_drops() -> None:
    long, short = (float(streaks(exposure_s=t).opacity(STILL, 0).max()) for t in (0.02, 0.0005))
    assert short > 3.0 * long


def test_only_pixels_with_a_drop_change_and_they_go_towards_the_mean() -> None:
    made = streaks(snow(3.0))
    rgb = np.full((240, 320, 3), 200, np.uint8)
    rgb[120:] = 20
    before = rgb.copy()
    made.draw(rgb, STILL, 7)
    touched = made.opacity(STILL, 7) > 0.0
    assert (rgb[~touched] == before[~touched]).all()
    assert np.mean(rgb != before) > 0.01
    assert (rgb[:120] <= 200).all()
    assert (rgb[120:] >= 20).all()


def test_pictures_differ_by_their_number_and_not_by_what_was_drawn_before() -> None:
    made = streaks()
    first = made.opacity(STILL, 3).copy()
    made.opacity(STILL, 4)
    assert made.opacity(STILL, 3).tobytes() == first.tobytes()
    assert made.opacity(STILL, 4).tobytes() != first.tobytes()


def test_a_cloudburst_before_a_fine_lens_draws_the_nearest_drops() -> None:
    fine = CameraModel.from_fov(1920, 1080, 60.0)
    made = RainStreaks(rain(150.0), fine, exposure_s=0.0005, wind_W_mps=(0.0, 0.0, 0.0), key=(1, 2))
    assert made.mean_count <= 20_000.0 * (1.0 + 1e-9)
