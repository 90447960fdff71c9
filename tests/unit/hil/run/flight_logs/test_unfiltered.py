"""The autopilot's low-pass is taken back: Butterworth filters made by scipy, at the sensor's rate, logged at 200 Hz."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from hil.run.flight_logs.flight_log import Series
from hil.run.flight_logs.unfiltered import LowPass, band_of, within_band

PERIOD_S = 0.005
TWENTY = LowPass(20.0, 1000.0, 1000.0)
FILTERS = {
    "20 Hz at 1 kHz": TWENTY,
    "20 Hz at 400 Hz": LowPass(20.0, 400.0, 400.0),
    "20 Hz for 1 kHz, run at 400 Hz": LowPass(20.0, 1000.0, 400.0),
}


def logged(motion: NDArray[np.float64], low_pass: LowPass = TWENTY) -> NDArray[np.float64]:
    """Return samples of motion at the filter's rate, filtered, at the log's rate."""
    b, a = butter(2, low_pass.cutoff_hz, fs=low_pass.designed_hz)
    return np.asarray(lfilter(b, a, motion, axis=0)[:: round(low_pass.rate_hz * PERIOD_S)], np.float64)


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("hz", [0.5, 3.0, 8.0, 15.0, 25.0])
def test_motion_is_restored_with_its_time(hz: float, name: str) -> None:
    low_pass = FILTERS[name]
    t = np.arange(0.0, 6.0, 1.0 / low_pass.rate_hz)
    motion = np.column_stack([np.sin(2 * np.pi * hz * t), np.cos(2 * np.pi * hz * t)])
    every = round(low_pass.rate_hz * PERIOD_S)
    series = Series(t[::every], logged(motion, low_pass))
    found = within_band(series, 50.0, low_pass)
    assert found is not None
    inside = slice(200, -200)
    off = found.values[inside] - motion[::every][inside]
    assert np.abs(off).max() < 0.006  # of which the band takes 0.004 at 25 Hz
    assert np.abs(series.values[inside] - motion[::every][inside]).max() > 0.03  # as logged it is late


def test_coefficients_for_another_rate_move_the_cut_off() -> None:
    assert FILTERS["20 Hz at 400 Hz"].passed_hz == pytest.approx(20.0)
    assert FILTERS["20 Hz for 1 kHz, run at 400 Hz"].passed_hz == pytest.approx(8.0, abs=0.02)


def test_the_band_passes_from_commands_to_readings() -> None:
    """A motor that lags behind commands held for a period: its speeds within the band, and those of the commands."""
    random = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, PERIOD_S)
    commands = Series(t, random.uniform(0.4, 0.6, (len(t), 1)))

    def speeds(held: Series) -> Series:
        left, out = np.exp(-PERIOD_S / 0.03), np.zeros(len(t))
        for k in range(1, len(t)):
            out[k] = left * out[k - 1] + (1.0 - left) * held.values[k - 1, 0]
        return Series(t, out[:, None])

    band_hz = band_of([TWENTY], PERIOD_S)
    banded = within_band(commands, band_hz)
    wanted = within_band(speeds(commands), band_hz)
    assert banded is not None
    assert wanted is not None
    inside = slice(200, -200)
    off = {what: np.abs(speeds(held).values - wanted.values)[inside].max() for what, held in
           (("banded", banded), ("as logged", commands))}  # fmt: skip
    assert off["banded"] < 1e-5
    assert off["as logged"] > 2e-3


def test_stretches_between_gaps_do_not_mix() -> None:
    t = np.arange(0.0, 6.0, 1e-3)
    values = logged(np.sin(2 * np.pi * 2.0 * t)[:, None])
    times = t[::5]
    kept = (times < 2.0) | (times > 3.0)
    whole = within_band(Series(times, values), 50.0, TWENTY)
    cut = within_band(Series(times[kept], values[kept]), 50.0, TWENTY)
    assert whole is not None
    assert cut is not None
    middle = (times[kept] < 1.7) | (times[kept] > 3.3)
    np.testing.assert_allclose(cut.values[middle], whole.values[kept][middle], atol=1e-3)
    assert np.abs(cut.values).max() < 1.5


def test_a_constant_stays_and_slow_logs_are_left() -> None:
    t = np.arange(0.0, 2.0, PERIOD_S)
    series = Series(t, np.full((len(t), 3), 9.81))
    found = within_band(series, 50.0, TWENTY)
    assert found is not None
    np.testing.assert_allclose(found.values, 9.81, rtol=1e-12)
    assert band_of([TWENTY], PERIOD_S) == pytest.approx(50.0)
    assert band_of([LowPass(60.0, 1000.0, 1000.0)], 0.004) == pytest.approx(100.0)  # 0.8 of half the rate
    assert band_of([TWENTY], 4 * PERIOD_S) == 0.0
    assert band_of([], PERIOD_S) == 0.0
    assert within_band(series, 0.0, TWENTY) is series
    assert within_band(None, 50.0) is None
