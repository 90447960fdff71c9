"""The autopilot's low-pass is taken back: a Butterworth filter made by scipy, run at 1 kHz and logged at 200 Hz."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from hil.run.flight_logs.flight_log import Series
from hil.run.flight_logs.unfiltered import unfiltered

CUTOFF_HZ = 20.0


def logged(motion: NDArray[np.float64]) -> NDArray[np.float64]:
    b, a = butter(2, CUTOFF_HZ, fs=1000.0)
    return np.asarray(lfilter(b, a, motion, axis=0)[::5], np.float64)


@pytest.mark.parametrize("hz", [0.5, 3.0, 8.0, 15.0, 25.0])
def test_motion_is_restored_with_its_time(hz: float) -> None:
    t = np.arange(0.0, 6.0, 1e-3)
    motion = np.column_stack([np.sin(2 * np.pi * hz * t), np.cos(2 * np.pi * hz * t)])
    series = Series(t[::5], logged(motion))
    found = unfiltered(series, CUTOFF_HZ)
    assert found is not None
    inside = slice(200, -200)
    off = found.values[inside] - motion[::5][inside]
    assert np.abs(off).max() < 0.01
    assert np.abs(series.values[inside] - motion[::5][inside]).max() > 0.03  # as logged it is late


def test_stretches_between_gaps_do_not_mix() -> None:
    t = np.arange(0.0, 6.0, 1e-3)
    values = logged(np.sin(2 * np.pi * 2.0 * t)[:, None])
    times = t[::5]
    kept = (times < 2.0) | (times > 3.0)
    whole = unfiltered(Series(times, values), CUTOFF_HZ)
    cut = unfiltered(Series(times[kept], values[kept]), CUTOFF_HZ)
    assert whole is not None
    assert cut is not None
    middle = (times[kept] < 1.7) | (times[kept] > 3.3)
    np.testing.assert_allclose(cut.values[middle], whole.values[kept][middle], atol=1e-3)
    assert np.abs(cut.values).max() < 1.5


def test_a_constant_stays_and_slow_logs_are_left() -> None:
    t = np.arange(0.0, 2.0, 0.005)
    series = Series(t, np.full((len(t), 3), 9.81))
    found = unfiltered(series, CUTOFF_HZ)
    assert found is not None
    np.testing.assert_allclose(found.values, 9.81, rtol=1e-12)
    assert unfiltered(series, 0.0) is series
    slow = Series(t[::4], series.values[::4])
    assert unfiltered(slow, CUTOFF_HZ) is slow
    assert unfiltered(None, CUTOFF_HZ) is None
