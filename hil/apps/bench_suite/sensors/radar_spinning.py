"""Part of `hil bench radar`: a revolution of a spinning radar, each number of rays with its error beside its time.

error    rms over azimuths of the power of an azimuth in city_park, against eight columns of rays in a step and rays of
         0.125 degrees in elevation: glints of walls and foliage are found by chance. Against a direct sum, on small
         scenes: tests/reference/test_radar_spinning.py
time     of a revolution, from rays to points
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import best_times
from signals.samples import TruthState
from sim.frame.source import SharedFrames
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from sim.sensors.spinning_radar import SpinningRadar
from sim.world_loader import load_world

_PLACE_M, _ZERO = (0.0, 0.0, 1.8), (0.0, 0.0, 0.0)
_PRESET = "navtech_cts350x"
_TRUE = {"columns_per_azimuth": 8, "elevation_spacing_deg": 0.125}
_DEFAULT = (2, 0.5)
_RAYS = ((1, 1.0), _DEFAULT, (4, 0.25))  # columns in a step, degrees in elevation


def spinning_rows(result: BenchmarkResult, *, quick: bool, status: ShowStatus) -> None:
    """Add rows for numbers of rays, and a check of the default's error."""
    scene = load_scene("city_park")
    frames = SharedFrames(load_world(scene))
    truth = TruthState(0, 10**9, _PLACE_M, (1.0, 0.0, 0.0, 0.0), _ZERO, _ZERO, _ZERO, _ZERO, (), False)

    def radar(**rays: float) -> SpinningRadar:
        made = make_sensor(
            Installation("spinning", rate_hz=4.0, seed=1, scene=scene, step_ns=4_000_000, frames=frames),
            preset=_PRESET,
            overrides={"rolling": False, **rays},
        )
        assert isinstance(made, SpinningRadar)
        return made

    def by_azimuth(sensor: SpinningRadar) -> NDArray[np.float64]:
        sensor.sample(truth, 0)
        return sensor.power_w.sum(axis=1)

    status("a spinning radar")
    true = by_azimuth(radar(**_TRUE))
    for columns, spacing_deg in (_DEFAULT,) if quick else _RAYS:
        sensor = radar(columns_per_azimuth=columns, elevation_spacing_deg=spacing_deg)
        error_db = float(np.sqrt(np.mean(np.square(10.0 * np.log10(by_azimuth(sensor) / true)))))
        time_s = best_times({"revolution": partial(sensor.sample, truth, 0)}, rounds=3)["revolution"]
        name = f"{columns} columns, {spacing_deg:g} deg"
        result.rows.append(Row(f"{_PRESET} in city_park", name, error_db, "dB", time_s, {}))
        if (columns, spacing_deg) == _DEFAULT:
            result.checks.append(Check(f"{_PRESET}: power of an azimuth, rms", error_db, "<=", 3.0, "dB"))
