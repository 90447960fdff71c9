"""What a radar must get right about single points: table 3, range, speed, angle and superposition."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.radar_cases import radar_parameters, random_echoes
from hil.bench_suite.result import Check
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.echoes import Echoes
from sim.radar.processing.processor import Processor
from sim.radar.synthesis import Synthesizer
from sim.sensors.radar_parameters import RadarParameters

Float64 = NDArray[np.float64]
_MIDDLE = 2048.0  # of the ADC's range
_AMPLITUDE = 100.0  # counts


def characteristic_checks() -> list[Check]:
    """Table 3 of the paper, each figure to the digits that it prints. It takes light for 3e8 m/s and cuts v_max off."""
    chirp = radar_parameters().chirp
    rounded = 3e8 / SPEED_OF_LIGHT_MPS
    checks = []
    for name, value, printed, unit in (
        ("v_max", chirp.max_speed_mps, 3.15, "m/s"),
        ("v_res", chirp.speed_resolution_mps, 0.10, "m/s"),
        ("d_res", chirp.range_resolution_m, 0.38, "m"),
        ("d_max", chirp.max_range_m, 12.0, "m"),
    ):
        checks.append(
            Check(f"{name}, off table 3 ({printed:g} {unit})", abs(rounded * value - printed), "<=", 0.0051, unit)
        )
    return checks


def target_checks(*, quick: bool) -> list[Check]:
    """Points through the processing chain; law and superposition of the exact sum."""
    p = radar_parameters()
    random = np.random.Generator(np.random.Philox(5))
    worst = {"range": 0.0, "speed": 0.0, "azimuth": 0.0, "elevation": 0.0}
    missed = 0
    processor = Processor(p.chirp, p.antenna.rx_positions_m, p.processing)
    farthest_m = p.chirp.max_range_m - 1.75 * p.chirp.range_resolution_m  # no peak in the last bin: see PeakFinder
    for _ in range(40 if quick else 400):
        processor.reset()
        range_m = random.uniform(1.5, farthest_m)
        speed = random.uniform(0.4, 0.96 * p.chirp.max_speed_mps) * random.choice([-1.0, 1.0])
        azimuth, elevation = np.deg2rad(random.uniform(-50.0, 50.0)), np.deg2rad(random.uniform(-30.0, 30.0))
        points = processor.process(_digitised(p, [(range_m, speed, azimuth, elevation)]), 0, until="points").points
        if len(points) == 0:
            missed += 1
            continue
        found = points[int(np.argmax(points["snr_db"]))]
        worst["range"] = max(worst["range"], abs(float(found["range_m"]) - range_m) / p.chirp.range_resolution_m)
        worst["speed"] = max(worst["speed"], abs(float(found["speed_mps"]) - speed) / p.chirp.speed_resolution_mps)
        worst["azimuth"] = max(worst["azimuth"], abs(math.degrees(float(found["azimuth_rad"]) - azimuth)))
        worst["elevation"] = max(worst["elevation"], abs(math.degrees(float(found["elevation_rad"]) - elevation)))
    return [
        Check("point targets that are not seen", float(missed), "<=", 0.0, "1"),
        Check("point targets: range", worst["range"], "<=", 0.05, "bins"),
        Check("point targets: speed", worst["speed"], "<=", 0.05, "bins"),
        Check("point targets: azimuth", worst["azimuth"], "<=", 0.5, "degrees"),
        Check("point targets: elevation", worst["elevation"], "<=", 0.5, "degrees"),
        Check("superposition of the exact sum", _superposition_error(p), "<=", 1e-12, "1"),
    ]


def direction(azimuth_rad: float, elevation_rad: float) -> Float64:
    """Unit direction in R."""
    c = math.cos(elevation_rad)
    return np.array([c * math.cos(azimuth_rad), c * math.sin(azimuth_rad), math.sin(elevation_rad)])


def _digitised(p: RadarParameters, targets: list[tuple[float, float, float, float]]) -> NDArray[np.uint16]:
    """What a perfect receiver puts out."""
    directions = np.array([direction(azimuth, elevation) for _, _, azimuth, elevation in targets])
    echoes = Echoes(
        np.array([t[0] for t in targets]),
        np.array([t[1] for t in targets]),
        directions,
        np.full(len(targets), _AMPLITUDE),
    )
    return np.rint(_exact(p, echoes) + _MIDDLE).astype(np.uint16)


def _exact(p: RadarParameters, echoes: Echoes) -> Float64:
    out = np.empty((len(p.antenna.rx_positions_m), p.chirp.chirps, p.chirp.samples))
    Synthesizer(p.chirp, p.antenna.rx_positions_m, hp_cutoff_hz=None, aaf_cutoff_hz=None, method="direct").synthesize(
        echoes, out
    )
    return out


def _superposition_error(p: RadarParameters) -> float:
    a, b = random_echoes(500, seed=7), random_echoes(300, seed=8)
    both = Echoes(*(np.concatenate(pair) for pair in zip(_arrays(a), _arrays(b), strict=True)))
    together = _exact(p, both)
    return float(np.linalg.norm(together - _exact(p, a) - _exact(p, b)) / np.linalg.norm(together))


def _arrays(e: Echoes) -> tuple[Float64, Float64, Float64, Float64]:
    return e.range_m, e.speed_mps, e.direction_R, e.amplitude
