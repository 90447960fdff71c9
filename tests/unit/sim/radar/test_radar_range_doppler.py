"""Range-Doppler maps against numpy's transforms, and windows and clutter removal against their formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Clutter, Processing, WindowName
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import ratio_table, response, side_lobes, window
from sim.radar.virtual_array import as_array
from tests.worlds.radar_point_targets import CHIRP, counts, signal_of

WINDOWS: tuple[WindowName, ...] = ("none", "hann", "hamming", "blackman", "taylor")
ARRAY = as_array([(0.0, 0.0, 0.0)] * 3)
RAW = np.random.default_rng(3).integers(0, 4096, (3, 64, 64)).astype(np.uint16)


def reference(raw: NDArray[np.uint16], maps: RangeDoppler, p: Processing) -> NDArray[np.float64]:
    """The map by the formulas in range_doppler.py, with numpy."""
    x = raw.astype(np.float64)
    fast, slow = np.array(maps.fast_window), np.array(maps.slow_window)
    if p.remove_chirp_mean:
        x = x - (x @ fast / fast.sum())[:, :, None]
    if p.clutter == "mean":
        x = x - np.einsum("kmn,m->kn", x, slow / slow.sum())[:, None, :]
    if p.clutter == "mti2":
        x = np.diff(x, axis=1) / math.sqrt(2.0)
    if p.clutter == "mti3":
        x = np.diff(x, n=2, axis=1) / math.sqrt(6.0)
    spectrum = np.fft.fft(x * fast * slow[:, None], 2 * maps.columns, axis=2)[:, :, : maps.columns]
    spectrum = np.fft.fftshift(np.fft.fft(spectrum, maps.rows, axis=1), axes=1)
    power: NDArray[np.float64] = np.mean(np.abs(2.0 * spectrum / (fast.sum() * slow.sum())) ** 2, axis=0)
    return power


@pytest.mark.parametrize("name", WINDOWS)
@pytest.mark.parametrize("clutter", ["none", "mean", "mti2", "mti3"])
def test_the_map_is_that_of_numpy(name: WindowName, clutter: Clutter) -> None:
    p = Processing(range_window=name, doppler_window=name, clutter=clutter)
    maps = RangeDoppler(CHIRP, ARRAY, p)
    power = maps.compute(RAW)
    assert power.shape == (64, 32)
    expected = reference(RAW, maps, p)
    assert power == pytest.approx(expected, rel=1e-6, abs=1e-9 * expected.max())


@pytest.mark.parametrize(("samples", "chirps", "receivers"), [(8, 2, 1), (50, 37, 2), (128, 16, 4), (64, 65, 3)])
@pytest.mark.parametrize("padding", [1, 2])
def test_any_number_of_chirps_and_samples(samples: int, chirps: int, receivers: int, padding: int) -> None:
    chirp = Chirp.model_validate(CHIRP.model_dump() | {"samples": samples, "chirps": chirps})
    p = Processing.model_validate(
        {"range_padding": padding, "doppler_padding": padding, "clutter": "none", "remove_chirp_mean": False}
    )
    maps = RangeDoppler(chirp, as_array([(0.0, 0.0, 0.0)] * receivers), p)
    raw = np.random.default_rng(samples).integers(0, 65536, (receivers, chirps, samples)).astype(np.uint16)
    power = maps.compute(raw)
    assert power.shape == (
        padding * 2 ** math.ceil(math.log2(chirps)),
        padding * 2 ** math.ceil(math.log2(samples)) // 2,
    )
    expected = reference(raw, maps, p)
    assert power == pytest.approx(expected, rel=1e-6, abs=1e-9 * expected.max())
    spectrum = np.mean([np.abs(maps.spectrum(k)) ** 2 for k in range(receivers)], axis=0)
    gain = 4.0 / (sum(maps.fast_window) * sum(maps.slow_window)) ** 2
    assert power == pytest.approx(gain * spectrum, rel=1e-6, abs=1e-9 * expected.max())


@pytest.mark.parametrize("name", WINDOWS)
def test_peak_power_is_the_square_of_the_amplitude(name: WindowName) -> None:
    maps = RangeDoppler(CHIRP, ARRAY, Processing(range_window=name, doppler_window=name, clutter="none"))
    row, column = 41, 12
    speed = (row - 32) * maps.speed_step_mps
    # A moving echo at range r appears at r + v f_c / S.
    range_m = column * maps.range_step_m - speed * CHIRP.center_frequency_hz / CHIRP.slope_hz_per_s
    power = maps.compute(counts(signal_of([(range_m, speed, 10.0, 5.0, 1000.0)])))
    assert np.unravel_index(power.argmax(), power.shape) == (row, column)
    assert 10.0 * math.log10(power.max() / 1000.0**2) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("n", [8, 37, 64])
@pytest.mark.parametrize("name", WINDOWS)
def test_windows_are_symmetric_and_have_their_spectra(name: WindowName, n: int) -> None:
    w = window(name, n)
    assert w == pytest.approx(w[::-1], abs=1e-12)
    for bins in (0.0, 0.3, 1.0, 2.5):
        phases = np.exp(-2j * np.pi * bins * (np.arange(n) - (n - 1) / 2) / n)
        assert response(w, bins, n) == pytest.approx(complex(np.dot(w, phases)).real, abs=1e-9)


def test_lobes_of_the_windows_are_those_of_the_books() -> None:
    # Greatest power from 2.5 bins on, or 7.5 for Taylor, whose nearer side lobes are equal.
    highest = {
        name: 10.0 * math.log10(side_lobes(window(name, 256), 256, 8)[0][8 if name == "taylor" else 3])
        for name in WINDOWS
    }
    assert highest["none"] == pytest.approx(-17.8, abs=0.3)  # the second side lobe
    assert highest["hann"] == pytest.approx(-31.5, abs=1.0)
    assert highest["taylor"] == pytest.approx(-40.0, abs=3.5)
    table = ratio_table(window("hann", 64), 64)
    # Ratio (a+ - a-) / (a- + a0 + a+) with a(d) = sinc(d) / (1 - d^2) (Hann). At d = 1/2, a0 = a+ = 1 and a- = 0.2.
    assert table[0] == 0.0
    assert table[-1] == pytest.approx((1.0 - 0.2) / 2.2, abs=2e-3)
    assert np.all(np.diff(table) > 0.0)


def test_clutter_removal_takes_what_stands_still_and_leaves_what_moves() -> None:
    still, moving = (5.0, 0.0, 0.0, 0.0, 500.0), (5.0, 1.0, 0.0, 0.0, 20.0)
    raw = counts(signal_of([still, moving]))
    plain = RangeDoppler(CHIRP, ARRAY, Processing(clutter="none")).compute(raw)
    row = 32 + round(1.0 / CHIRP.speed_resolution_mps)
    assert plain.max() > 0.4 * 500.0**2
    for clutter in ("mean", "mti2", "mti3"):
        maps = RangeDoppler(CHIRP, ARRAY, Processing.model_validate({"clutter": clutter}))
        power = maps.compute(raw)
        assert abs(int(power.max(axis=1).argmax()) - row) <= 1
        # The differences' own response: 2 sin(pi f T_c) once or twice, over the root of 2 or 6.
        s = 2.0 * math.sin(math.pi * 2.0 * 1.0 / CHIRP.wavelength_m * CHIRP.repetition_s)
        gain = {"mean": 1.0, "mti2": s**2 / 2.0, "mti3": s**4 / 6.0}[clutter]
        assert power.max() == pytest.approx(gain * plain[row - 1 : row + 2].max(), rel=0.1)


def test_a_learned_background_absorbs_a_standing_person_at_the_gain() -> None:
    leakage, person = (0.4, 0.0, 0.0, 0.0, 500.0), (4.0, 0.0, 0.0, 0.0, 30.0)
    maps = RangeDoppler(CHIRP, ARRAY, Processing(clutter="background"))
    empty, with_person = counts(signal_of([leakage])), counts(signal_of([leakage, person]))
    assert maps.compute(empty).max() < 1e-20  # the first frame is the background
    maps.compute(empty, background_gain=0.05)
    for frame in range(20):
        power = maps.compute(with_person, background_gain=0.05)
        expected = (30.0 * 0.95**frame) ** 2
        # 4 m lies between two cells, which costs up to 1.4 dB of the peak.
        assert power[32, 9:12].max() == pytest.approx(0.75 * expected, rel=0.35)
        assert power[32, :4].max() < 0.01 * expected + 0.1
    maps.reset()
    assert maps.compute(with_person).max() < 1e-20


def test_refusals() -> None:
    maps = RangeDoppler(CHIRP, ARRAY, Processing())
    with pytest.raises(ValueError, match="do not have the shape"):
        maps.compute(RAW[:2])
    with pytest.raises(TypeError):
        maps.compute(RAW.astype(np.int32))
