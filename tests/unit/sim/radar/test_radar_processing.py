"""The chain in one piece: a walker among clutter, an empty scene, equal bytes, a recording."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pydantic
import pytest
from numpy.typing import NDArray

from signals.errors import ConfigError
from sim.radar.processing.parameters import Processing
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.processor import Processor, process_recording
from sim.radar.processing.tracker import TRACK_DTYPE
from tests.worlds.radar_point_targets import CHIRP, L_ARRAY, Target, counts, signal_of

PERIOD_NS = 50_000_000
LEAKAGE: list[Target] = [(0.35, 0.0, 0.0, 0.0, 300.0), (0.7, 0.0, 0.0, 0.0, 120.0)]
CLUTTER: list[Target] = [(5.0, 0.0, 25.0, -5.0, 60.0), (8.0, 0.0, -22.0, -4.0, 40.0)]


def walker(range_m: float, speed: float, phase: float) -> list[Target]:
    """A trunk of two points and limbs that swing past it; amplitudes fall with the square of range."""
    scale, swing = (3.0 / range_m) ** 2, 2.0 * speed * math.sin(phase)
    limbs = [(0.25, 0.9 * swing, 6.0), (-0.25, -0.9 * swing, 6.0), (0.1, 0.5 * swing, 4.0), (-0.1, -0.4 * swing, 4.0)]
    trunk = [(range_m, speed, 4.0, -8.0, 30.0 * scale), (range_m + 0.1, speed, 5.0, -2.0, 15.0 * scale)]
    return trunk + [(range_m + dr, speed + dv, 4.0, -12.0, a * scale) for dr, dv, a in limbs]


def frame(i: int, *, speed: float, start_m: float) -> NDArray[np.uint16]:
    person = walker(start_m + 0.05 * speed * i, speed, 2.0 * math.pi * i / 20.0)
    return counts(signal_of(LEAKAGE + CLUTTER + person), noise=1.1, seed=i)


@pytest.mark.parametrize(("speed", "start_m"), [(1.2, 1.5), (-1.2, 6.5)])
def test_a_walker_among_reflectors_and_leakage(speed: float, start_m: float) -> None:
    frames = 60
    processor = Processor(CHIRP, L_ARRAY, Processing())
    found, range_error, speed_error = 0, [], []
    for i in range(frames):
        processed = processor.process(frame(i, speed=speed, start_m=start_m), i * PERIOD_NS)
        tracks = processed.tracks
        assert len(tracks) <= 1  # nothing else moves
        if len(tracks):
            found += 1
            range_error.append(abs(tracks["range_m"][0] - (start_m + 0.05 * speed * i)))
            speed_error.append(abs(tracks["speed_mps"][0] - speed))
            assert np.degrees(tracks["azimuth_rad"][0]) == pytest.approx(4.0, abs=4.0)
    assert found >= 0.95 * frames
    assert max(range_error) < 0.2
    assert np.mean(speed_error) < 0.05
    assert max(speed_error[3:]) < 0.15


def test_an_empty_scene_is_noise_and_no_tracks() -> None:
    processor = Processor(CHIRP, L_ARRAY, Processing())
    seen = 0
    for i in range(40):
        raw = counts(signal_of(LEAKAGE + CLUTTER), noise=1.1, seed=i)
        processed = processor.process(raw, i * PERIOD_NS)
        assert np.isfinite(processed.range_doppler).all()
        assert np.median(processed.range_doppler) > 0.0
        assert len(processed.tracks) == 0
        seen += len(processed.points)
    assert seen <= 4  # at 1e-5 a cell, 0.02 a frame


def test_constant_samples_are_a_map_of_zeros() -> None:
    processed = Processor(CHIRP, L_ARRAY, Processing()).process(np.full((3, 64, 64), 4095, np.uint16), 0)
    assert processed.range_doppler.max() < 1e-20
    assert processed.points.shape == (0,)
    assert processed.points.dtype == POINT_DTYPE
    assert processed.tracks.shape == (0,)
    assert processed.tracks.dtype == TRACK_DTYPE


def digest(processor: Processor, frames: int = 12) -> str:
    sha = hashlib.sha256()
    for i in range(frames):
        processed = processor.process(frame(i, speed=1.2, start_m=2.0), i * PERIOD_NS)
        for array in (processed.range_doppler, processed.points, processed.tracks):
            sha.update(array.tobytes())
    return sha.hexdigest()


@pytest.mark.parametrize("clutter", ["mean", "background", "mti3"])
def test_equal_bytes_of_equal_frames_and_after_a_reset(clutter: str) -> None:
    p = Processing.model_validate({"clutter": clutter})
    digests = set()
    for _ in range(2):
        processor = Processor(CHIRP, L_ARRAY, p)
        digests.add(digest(processor))
        processor.reset()
        digests.add(digest(processor))
    assert len(digests) == 1


def test_points_are_strongest_first_and_no_more_than_asked_for() -> None:
    targets: list[Target] = [(2.0 + i, 0.85 * i - 2.2, 0.0, 0.0, 100.0 - 12.0 * i) for i in range(6)]
    raw = counts(signal_of(targets), noise=0.5)
    points = Processor(CHIRP, L_ARRAY, Processing(clutter="none")).process(raw, 0).points
    assert points["range_m"] == pytest.approx([2.0 + i for i in range(6)], abs=0.1)
    few = Processor(CHIRP, L_ARRAY, Processing(clutter="none", max_points=2)).process(raw, 0).points
    assert few.tobytes() == points[:2].tobytes()
    far = Processor(CHIRP, L_ARRAY, Processing(clutter="none", min_range_m=3.6)).process(raw, 0).points
    assert far.tobytes() == points[2:].tobytes()


def test_side_lobes_of_a_strong_echo_are_no_points() -> None:
    for window in ("hann", "hamming", "blackman", "taylor"):
        p = Processing.model_validate({"range_window": window, "doppler_window": window, "clutter": "none"})
        raw = counts(signal_of([(5.6, 1.03, 10.0, 0.0, 1500.0)]), noise=0.5)
        points = Processor(CHIRP, L_ARRAY, p).process(raw, 0).points
        assert len(points) == 1, window


def test_a_recording_is_processed_as_the_sensor_would() -> None:
    adc = np.stack([frame(i, speed=1.2, start_m=2.0) for i in range(6)])
    live = Processor(CHIRP, L_ARRAY, Processing())
    for i, processed in enumerate(process_recording(adc, CHIRP, L_ARRAY, period_ns=PERIOD_NS)):
        expected = live.process(adc[i], i * PERIOD_NS)
        assert processed.range_doppler.tobytes() == expected.range_doppler.tobytes()
        assert processed.tracks.tobytes() == expected.tracks.tobytes()


def test_refusals() -> None:
    adc = np.zeros((2, 3, 64, 64), np.uint16)
    with pytest.raises(ConfigError, match="but the chirp and the array need"):
        process_recording(adc[:, :, :32], CHIRP, L_ARRAY, period_ns=PERIOD_NS)
    with pytest.raises(ConfigError, match="not uint16"):
        process_recording(adc.astype(np.float64), CHIRP, L_ARRAY, period_ns=PERIOD_NS)
    with pytest.raises(ConfigError, match="not positive"):
        process_recording(adc, CHIRP, L_ARRAY, period_ns=0)
    with pytest.raises(pydantic.ValidationError, match="range_window"):
        Processing.model_validate({"range_window": "kaiser"})
    with pytest.raises(pydantic.ValidationError, match="clutter"):
        Processing.model_validate({"clutter": "mti4"})
