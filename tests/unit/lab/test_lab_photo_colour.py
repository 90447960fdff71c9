"""Comparison of the raster's colour with path-traced colour, on synthetic light in place of both."""

from __future__ import annotations

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import field_case
from lab import photo_colour
from signals.errors import RecordingError
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced import tone


def _reference(light: np.ndarray) -> photo_colour.Reference:
    return photo_colour.Reference([light], [light], [np.ones(light.shape[:2], bool)])


@pytest.fixture
def light() -> np.ndarray:
    return np.random.default_rng(1).uniform(0.02, 0.8, (40, 50, 3))


def test_codes_of_the_path_tracer_give_back_its_light(light: np.ndarray) -> None:
    codes = tone.to_srgb(3.0 * light, 3.0, np.ones(3))
    assert np.abs(photo_colour._light_of(codes) - light).max() < 0.02  # a code's step there


def test_exposure_is_matched_and_a_lost_shadow_is_an_error(light: np.ndarray) -> None:
    same = photo_colour._errors([0.3 * light], _reference(light))
    assert same.light < 1e-9
    assert same.codes < 1e-9
    assert same.ssim == pytest.approx(1.0)
    shadow = light.copy()
    shadow[10:20, 10:30] *= 0.2
    without = photo_colour._errors([light], _reference(shadow))
    # A tenth of the pixels has a fifth of its light. The matched picture has 0.92 everywhere: 0.08 too little in nine
    # tenths, 0.72 too much in one, relative to the mean of 0.92.
    assert without.light == pytest.approx(100.0 * (0.9 * 0.08 + 0.1 * 0.72) / 0.92, rel=0.05)
    assert without.ssim < 0.99


def test_a_tone_curve_is_compared_at_the_same_mean(light: np.ndarray) -> None:
    factor = photo_colour._factor_for(photo_colour._filmic, light, 0.3)
    assert photo_colour._filmic(factor * light).mean() == pytest.approx(0.3, abs=1e-6)
    assert photo_colour._errors([light], _reference(light), photo_colour._filmic).codes > 1.0


class _Dark:
    """Path tracer whose pictures are black."""

    def __init__(self, *args: object, **settings: object) -> None: ...

    def render(self, pose: object, out: dict[str, np.ndarray]) -> None:
        out["rgb"][:] = 0


def test_a_scene_of_which_all_views_are_dark_is_a_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photo_colour, "PathTracedRenderer", _Dark)
    case = field_case(5, seed=1, views=2)
    with pytest.raises(RecordingError, match="no pixel of the path tracer's pictures from 2 viewpoints counts"):
        photo_colour._reference(case, FrameGeometry(case.world), CameraModel.from_fov(32, 24, 90.0), None)  # type: ignore[arg-type]
