"""Part of `hil bench radar`: the presets with several transmitters, each with its error beside its time.

random echoes        5,000 to 0.9 of the preset's range, to 10 m/s, against the exact sum
city_park            pictures of 320 x 240: the sum of all their echoes; the AWR1843 with TX1 and TX3 before four
                     receivers and 128 chirps of 256 samples for each, as a frame from picture to codes
point targets        in the array's field, to its unambiguous speed, through synthesis, rounding and processing
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.radar_cases import PIXELS, radar_parameters, radar_view, synthesizer
from hil.apps.bench_suite.sensors.raster_cases import scene_case
from hil.apps.bench_suite.timing import best_times
from sim.radar.adc import RadarReceiverChain
from sim.radar.echoes import Echoes
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from sim.radar.synthesis import Synthesizer
from sim.sensors.radar_parameters import RadarParameters

Float64 = NDArray[np.float64]
PRESETS = ("iwr6843isk", "iwr6843ods", "awr1843boost", "awr2243boost")
_UNIT = "relative, to the exact sum"
_TOLERANCE = 1e-3
_AMPLITUDE, _ADC_CENTRE = 10_000.0, 32768.0  # counts


def two_by_four() -> RadarParameters:
    """Return the AWR1843 with TX1 and TX3, 128 chirps of 256 samples each."""
    p = radar_parameters("awr1843boost").model_dump()
    p["antenna"]["tx_positions_m"] = p["antenna"]["tx_positions_m"][:2]
    p["chirp"]["chirps"] = 256
    return RadarParameters.model_validate(p)


def city_park_arrays(result: BenchmarkResult, *, quick: bool, status: ShowStatus) -> None:
    """Measure pictures of city_park: errors against the exact sum over all echoes, and processor times."""
    cases = {"awr1843boost, 2 x 4, 128 chirps of 256": two_by_four()}
    if quick:
        result.left_out.append("presets with several transmitters in city_park, but for the AWR1843 and one view")
    else:
        cases |= {name: radar_parameters(name) for name in PRESETS}
    case = scene_case("city_park", views=1 if quick else 4, seed=1)
    for name, p in cases.items():
        status(f"city_park, {name}")
        radar = radar_view(case.world, p)
        signal, exact, codes = np.empty(p.raw_shape), np.empty(p.raw_shape), np.empty(p.raw_shape, np.uint16)
        transform, direct = synthesizer(p, "nufft", _TOLERANCE), synthesizer(p, "direct", _TOLERANCE)
        chain = RadarReceiverChain(
            p.chirp, p.impairments, p.raw_shape[0], seed=1, name="radar", adc_bits=p.receiver.adc_bits
        )
        times_s: list[float] = []
        frames_s: list[float] = []
        direct_s: list[float] = []
        errors: list[float] = []
        for k, view in enumerate(case.views):
            radar.draw(view)
            echoes = radar.echoes(view)
            transform.synthesize(echoes, signal)  # the first call allocates its buffers
            if k < 2:  # the exact sum takes up to half a minute
                direct_s.append(best_times({"": partial(direct.synthesize, echoes, exact)})[""])
                errors.append(_error(signal, exact))
            steps = best_times(
                {
                    "collect": partial(radar.echoes, view),
                    "sum": partial(transform.synthesize, echoes, signal),
                    "digitise": partial(chain.digitise, signal, k, codes),
                },
                rounds=3 if quick else 5,
            )
            times_s.append(steps["sum"])
            frames_s.append(sum(steps.values()))
        title, worst = f"city_park, {name}", max(errors)
        details = {"frame_s": float(np.mean(frames_s)), "pixels": float(PIXELS), "views": len(case.views)}
        result.rows.append(Row(title, f"nufft @ {_TOLERANCE:g}", worst, _UNIT, float(np.mean(times_s)), details))
        result.rows.append(Row(title, "direct", 0.0, _UNIT, float(np.mean(direct_s))))
        result.checks.append(Check(f"{title}: error", worst, "<=", _TOLERANCE, "1"))
        if p.chirp.chirps == 256:
            slowest_ms = 1e3 * max(frames_s)
            result.checks.append(Check(f"{title}: frame, slowest view", slowest_ms, "<=", 25.0, "ms", "speed"))


def array_target_checks(*, quick: bool) -> list[Check]:
    """Return checks of point targets before each array."""
    checks = []
    for name in PRESETS:
        p = radar_parameters(name)
        p = p.model_copy(update={"processing": Processing(clutter="none")})
        for part, value in zip(("range", "speed", "azimuth", "elevation"), _worst(p, 10 if quick else 60), strict=True):
            limit, unit = (0.001, "bins") if part in ("range", "speed") else (0.02, "degrees")
            checks.append(Check(f"{name}, point targets: {part}", value, "<=", limit, unit))
    return checks


def _worst(p: RadarParameters, count: int) -> tuple[float, ...]:
    """Return the greatest errors: range and speed in bins, azimuth and elevation in degrees."""
    rng = np.random.Generator(np.random.Philox(11))
    processor, seen = Processor(p.chirp, p.antenna.array, p.processing), p.seen
    exact = Synthesizer(p.chirp, p.antenna.array, hp_cutoff_hz=None, aaf_cutoff_hz=None, method="direct")
    signal = np.empty(p.raw_shape)
    fastest_mps = 0.98 * seen.max_speed_mps
    worst = [0.0] * 4
    for k in range(count):
        range_m = rng.uniform(3.0, 0.9 * p.chirp.samples) * seen.range_resolution_m
        speed_mps = rng.uniform(-fastest_mps, fastest_mps)
        across, up = (math.radians(limit) for limit in p.antenna.field_deg or (0.0, 0.0))
        azimuth, elevation = rng.uniform(-across, across), rng.uniform(-up, up)
        c = math.cos(elevation)
        direction_R = np.array([[c * math.cos(azimuth), c * math.sin(azimuth), math.sin(elevation)]])
        target = Echoes(np.array([range_m]), np.array([speed_mps]), direction_R, np.array([_AMPLITUDE]))
        exact.synthesize(target, signal)
        codes = np.floor(signal + (_ADC_CENTRE + 0.5)).astype(np.uint16)
        point: Any = processor.process(codes, k, until="points").points[0]
        found = (
            (float(point["range_m"]) - range_m) / seen.range_resolution_m,
            (float(point["speed_mps"]) - speed_mps) / seen.speed_resolution_mps,
            math.degrees(float(point["azimuth_rad"]) - azimuth),
            math.degrees(float(point["elevation_rad"]) - elevation),
        )
        worst = [max(w, abs(f)) for w, f in zip(worst, found, strict=True)]
    return tuple(worst)


def _error(x: Float64, exact: Float64) -> float:
    return float(np.linalg.norm(x - exact) / np.linalg.norm(exact))
