"""The report of several vehicles: distances between tracks with different rows."""

from __future__ import annotations

import numpy as np
import pytest

from hil.run.recorder.track import Track
from hil.run.report.group_report import _distances
from tests.worlds.mjcf_world import truth_at

TICK_NS = 40_000_000


def test_distances_are_those_at_the_same_time_after_one_track_was_decimated() -> None:
    long, short = Track(TICK_NS, limit=100), Track(TICK_NS, limit=100)
    for tick in range(150):
        x_m = 0.1 * tick
        long.truth(truth_at(tick * TICK_NS, tick=tick, p_WB=(x_m, 0.0, 10.0)))
        if tick < 60:
            short.truth(truth_at(tick * TICK_NS, tick=tick, p_WB=(x_m, 3.0, 10.0)))
    t_s, distance_m = _distances(long.arrays(), short.arrays())
    assert t_s == pytest.approx(np.arange(0, 60, 2) * 0.04)
    assert distance_m == pytest.approx(3.0)
