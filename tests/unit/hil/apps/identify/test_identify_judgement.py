"""Judgement of a fit by errors that are no numbers."""

from __future__ import annotations

import math

import pytest

from hil.apps.identify.fit_result import Prediction
from hil.apps.identify.judgement import error_ratio


def prediction(position_m: float, velocity_mps: float = 1.0) -> Prediction:
    return Prediction("log", 0.1, position_m, velocity_mps, math.nan, math.nan)


@pytest.mark.parametrize(
    ("before_m", "after_m", "ratio"),
    [
        (1.0, 4.0, 2.0),
        (math.inf, 4.0, 1.0),  # it ended with a traceback
        (math.inf, math.inf, math.inf),
        (1.0, math.nan, math.inf),
        (math.nan, 4.0, 1.0),
    ],
)
def test_predictions_that_failed_are_no_better(before_m: float, after_m: float, ratio: float) -> None:
    assert error_ratio([(prediction(before_m), prediction(after_m))]) == pytest.approx(ratio)


def test_without_predictions_there_is_no_ratio() -> None:
    assert math.isnan(error_ratio([]))
