"""Point targets through the whole chain: range, speed, angle and amplitude against their true values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from tests.worlds.radar_point_targets import CHIRP, L_ARRAY, counts, signal_of
from tests.worlds.radar_recordings import WIDE

AMPLITUDE = 20_000.0  # so that rounding to counts is negligible


def errors(chirp: Chirp, p: Processing, count: int, *, slowest_bins: float = 0.0) -> NDArray[np.float64]:
    """Return (count, 5): range, speed in bins, azimuth, elevation in degrees, amplitude in dB at the cell's peak."""
    rng = np.random.default_rng(7)
    processor = Processor(chirp, L_ARRAY, p)
    rows = []
    for i in range(count):
        range_m = rng.uniform(3.0, 29.0) * chirp.range_resolution_m
        # Range migration within the frame smears the peak, so the fine chirp gets slow targets only.
        fastest = min(0.98 * chirp.max_speed_mps, 0.4 * chirp.range_resolution_m / chirp.frame_s)
        speed = rng.uniform(max(0.0, slowest_bins * chirp.speed_resolution_mps), fastest) * rng.choice([-1.0, 1.0])
        azimuth, elevation = rng.uniform(-60.0, 60.0), rng.uniform(-40.0, 40.0)
        raw = counts(signal_of([(range_m, speed, azimuth, elevation, AMPLITUDE)], chirp), offset=32768.0)
        processed = processor.process(raw, i * 50_000_000)
        point = processed.points[0]
        rows.append(
            (
                (point["range_m"] - range_m) / chirp.range_resolution_m,
                (point["speed_mps"] - speed) / chirp.speed_resolution_mps,
                math.degrees(point["azimuth_rad"]) - azimuth,
                math.degrees(point["elevation_rad"]) - elevation,
                10.0 * math.log10(processed.range_doppler.max() / AMPLITUDE**2),
            )
        )
        x = point["range_m"] * np.cos(point["elevation_rad"]) * np.cos(point["azimuth_rad"])
        assert point["x_R"] == pytest.approx(x, rel=1e-4)
    return np.array(rows)


@pytest.mark.parametrize("window", ["hann", "hamming", "blackman", "taylor"])
@pytest.mark.parametrize("padding", [1, 2])
def test_range_speed_and_angle_between_bins(window: str, padding: int) -> None:
    changes: dict[str, Any] = {"range_window": window, "doppler_window": window, "clutter": "none"}
    changes |= {"range_padding": padding, "doppler_padding": padding}
    worst = np.abs(errors(CHIRP, Processing.model_validate(changes), 60)).max(axis=0)
    assert worst[0] < 0.02
    assert worst[1] < 0.02
    # Side lobes of the mirror image of the real samples do not decay and reach into the cell.
    limit_deg = 0.3 if window in ("hamming", "taylor") else 0.1
    assert worst[2] < limit_deg
    assert worst[3] < limit_deg


def test_without_a_window_the_mirror_image_costs_accuracy() -> None:
    p = Processing(range_window="none", doppler_window="none", clutter="none")
    worst = np.abs(errors(CHIRP, p, 100)).max(axis=0)
    assert worst[0] < 0.05
    assert worst[1] < 0.05
    assert worst[2] < 2.0


@pytest.mark.parametrize("clutter", ["mean", "mti2", "mti3"])
def test_clutter_removal_does_not_affect_moving_targets(clutter: str) -> None:
    p = Processing.model_validate({"clutter": clutter})
    assert np.abs(errors(CHIRP, p, 40, slowest_bins=4.0)[:, :4]).max() < 0.05


def test_chirps_of_the_real_sensor() -> None:
    worst = np.abs(errors(WIDE, Processing(clutter="none"), 60)).max(axis=0)
    assert worst[0] < 0.05
    assert worst[1] < 0.05
    assert worst[2] < 0.1


def test_speed_and_range_are_accurate_at_bin_boundaries() -> None:
    processor = Processor(CHIRP, L_ARRAY, Processing(clutter="none"))
    for i, off in enumerate(np.linspace(-0.5, 0.5, 41)):
        speed = (12.0 + off) * CHIRP.speed_resolution_mps
        coupling = speed * CHIRP.center_frequency_hz / CHIRP.slope_hz_per_s
        range_m = (14.0 - off) * CHIRP.range_resolution_m - coupling
        raw = counts(signal_of([(range_m, speed, 0.0, 0.0, AMPLITUDE)]), offset=32768.0)
        point = processor.process(raw, i * 50_000_000).points[0]
        assert point["range_m"] == pytest.approx(range_m, abs=0.005 * CHIRP.range_resolution_m)
        assert point["speed_mps"] == pytest.approx(speed, abs=0.005 * CHIRP.speed_resolution_mps)


def test_a_fast_target_is_folded_in_speed() -> None:
    """It crosses up to two range bins within the frame, which smears the peak and widens the error slightly."""
    processor = Processor(CHIRP, L_ARRAY, Processing(clutter="none"))
    whole = 2.0 * CHIRP.max_speed_mps
    for i, speed in enumerate((8.0, -14.0, 30.0)):
        seen = speed - whole * math.floor(speed / whole + 0.5)
        raw = counts(signal_of([(6.0, speed, 0.0, 0.0, AMPLITUDE)]), offset=32768.0)
        point = processor.process(raw, i * 50_000_000).points[0]
        assert point["speed_mps"] == pytest.approx(seen, abs=0.15 * CHIRP.speed_resolution_mps)
        short = (speed - seen) * CHIRP.center_frequency_hz / CHIRP.slope_hz_per_s
        assert point["range_m"] == pytest.approx(6.0 + short, abs=0.15 * CHIRP.range_resolution_m)


def test_noise_at_30_db_gives_the_theoretical_spread() -> None:
    """Peak 30 dB over the map's noise. The spread of d_y is sqrt(1 / SNR) lambda / (2 pi b): 0.57 degrees ahead."""
    noise, trials = 10.0, 120
    map_noise = noise**2 * (2.0 * math.sqrt(0.375 * 64 * 0.375 * 64) / (32.0 * 32.0)) ** 2
    amplitude = math.sqrt(1000.0 * map_noise)
    processor = Processor(CHIRP, L_ARRAY, Processing(clutter="none"))
    speed = 8 * CHIRP.speed_resolution_mps
    range_m = 12 * CHIRP.range_resolution_m - speed * CHIRP.center_frequency_hz / CHIRP.slope_hz_per_s
    rows = []
    for i in range(trials):
        raw = counts(signal_of([(range_m, speed, 20.0, 0.0, amplitude)]), noise=noise, seed=i)
        point = processor.process(raw, i * 50_000_000).points[0]
        assert point["snr_db"] == pytest.approx(30.0, abs=2.0)
        rows.append((point["range_m"] - range_m, point["speed_mps"] - speed, math.degrees(point["azimuth_rad"]) - 20.0))
    mean, rms = np.mean(rows, axis=0), np.sqrt(np.mean(np.square(rows), axis=0))
    theory_deg = math.degrees(math.sqrt(1e-3) * CHIRP.wavelength_m / (2.0 * math.pi * 2.5e-3)) / math.cos(
        math.radians(20.0)
    )
    assert rms[2] == pytest.approx(theory_deg, rel=0.25)
    assert abs(mean[2]) < 4.0 * theory_deg / math.sqrt(trials)
    assert rms[0] < 0.05 * CHIRP.range_resolution_m
    assert rms[1] < 0.05 * CHIRP.speed_resolution_mps
