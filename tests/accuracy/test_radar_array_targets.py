"""Point targets before the arrays of the presets: range, speed and angles through synthesis and processing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.radar.echoes import Echoes
from sim.radar.processing.processor import Processor
from sim.radar.synthesis import Synthesizer
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters
from tests.worlds.radar_point_targets import direction

ARRAYS = ("iwr6843isk", "iwr6843ods", "awr1843boost", "awr2243boost")
AMPLITUDE = 10_000.0  # so that rounding to counts is negligible


def preset(name: str, antenna: dict[str, Any] | None = None, **chirp: Any) -> RadarParameters:
    p = PRESETS[name].parameters
    assert isinstance(p, RadarParameters)
    changed = p.model_dump() | {"board": None, "processing": {"clutter": "none"}}
    changed["chirp"] = changed["chirp"] | chirp
    changed["antenna"] = changed["antenna"] | (antenna or {})
    changed["impairments"] = {}
    return RadarParameters.model_validate(changed)


def frame_of(p: RadarParameters, target: tuple[float, float, float, float]) -> NDArray[np.uint16]:
    """Return the codes of a target at range, speed, azimuth and elevation [degrees], without noise and filters."""
    range_m, speed_mps, azimuth_deg, elevation_deg = target
    echoes = Echoes(
        np.array([range_m]),
        np.array([speed_mps]),
        direction(azimuth_deg, elevation_deg)[None],
        np.array([AMPLITUDE]),
    )
    out = np.empty(p.raw_shape)
    Synthesizer(p.chirp, p.antenna.array, hp_cutoff_hz=None, aaf_cutoff_hz=None, method="direct").synthesize(
        echoes, out
    )
    return np.floor(out + 32768.5).astype(np.uint16)


def errors(p: RadarParameters, count: int) -> NDArray[np.float64]:
    """Return (count, 4): range and speed in bins, azimuth and elevation in degrees."""
    rng = np.random.default_rng(7)
    processor, seen = Processor(p.chirp, p.antenna.array, p.processing), p.seen
    assert p.antenna.field_deg is not None
    rows = []
    for i in range(count):
        range_m = rng.uniform(3.0, 0.9 * p.chirp.samples) * seen.range_resolution_m
        fastest = 0.98 * seen.max_speed_mps  # the peak is smeared over up to 1.4 range bins
        speed_mps = rng.uniform(-fastest, fastest)
        azimuth_deg, elevation_deg = (rng.uniform(-limit, limit) for limit in p.antenna.field_deg)
        point = processor.process(
            frame_of(p, (range_m, speed_mps, azimuth_deg, elevation_deg)), i, until="points"
        ).points[0]
        rows.append(
            (
                (point["range_m"] - range_m) / seen.range_resolution_m,
                (point["speed_mps"] - speed_mps) / seen.speed_resolution_mps,
                math.degrees(point["azimuth_rad"]) - azimuth_deg,
                math.degrees(point["elevation_rad"]) - elevation_deg,
            )
        )
    return np.array(rows)


@pytest.mark.parametrize("name", ARRAYS)
def test_targets_of_each_preset(name: str) -> None:
    worst = np.abs(errors(preset(name), 40)).max(axis=0)
    assert worst[0] < 0.001
    assert worst[1] < 0.001
    assert worst[2] < 0.02
    assert worst[3] < 0.02


@pytest.mark.parametrize("bands", [3, 4])
def test_targets_in_doppler_division(bands: int) -> None:
    p = preset("awr1843boost", {"mimo": "ddm", "doppler_bands": bands})
    worst = np.abs(errors(p, 20)).max(axis=0)
    assert worst[0] < 0.001
    assert worst[1] < 0.001
    assert worst[2] < 0.02
    assert worst[3] < 0.02


def test_without_the_turn_between_transmitters_angles_are_wrong() -> None:
    """The compensation is for this: a target at half of the unambiguous speed, seen 10 degrees or more off."""
    p = preset("awr1843boost")
    target = (10.0, 0.5 * p.seen.max_speed_mps, 20.0, 0.0)
    processor = Processor(p.chirp, p.antenna.array, p.processing)
    found = processor.process(frame_of(p, target), 0, until="points").points[0]
    assert math.degrees(found["azimuth_rad"]) == pytest.approx(20.0, abs=0.001)
    assert math.degrees(found["elevation_rad"]) == pytest.approx(0.0, abs=0.001)
    processor._points._turn_offsets = (0.0,) * 12
    wrong = processor.process(frame_of(p, target), 0, until="points").points[0]
    assert abs(math.degrees(wrong["elevation_rad"])) > 10.0
    assert wrong["range_m"] == found["range_m"]


@pytest.mark.parametrize("name", ARRAYS)
def test_no_mirror_image_with_complex_samples(name: str) -> None:
    """A target in the far half of the ranges is found there, and nothing but rounding is found elsewhere."""
    p = preset(name)
    far_m = 0.8 * p.chirp.samples * p.chirp.range_resolution_m
    points = Processor(p.chirp, p.antenna.array, p.processing).process(frame_of(p, (far_m, 0.3, 10.0, 5.0)), 0).points
    assert (points["snr_db"][1:] < points["snr_db"][0] - 50.0).all()
    assert points["range_m"][0] == pytest.approx(far_m, abs=0.01 * p.chirp.range_resolution_m)
