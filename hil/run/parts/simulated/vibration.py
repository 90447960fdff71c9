"""Vibration as the samples of the IMUs show it: spectrum, level, clipped readings; in runs with `vibration: estimated`.

The level is that of ArduPilot's VIBE (AP_InertialSensor::calc_vibration_and_clipping), by axis:

    d = a - low-pass(a, 5 Hz),   VIBE = sqrt(low-pass(d^2, 2 Hz))      low-passes of order 1

ArduPilot's documents call levels below 15 m/s2 good, 30 acceptable and 60 bad.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from signals.detections import Detections
from signals.samples import ImuSample, Sample
from sim.sensors.imu import Imu

_MOST_SAMPLES = 2_000_000  # of an IMU; of a longer flight the first
_SHORTEST = 512  # samples of a spectrum
_SHOWN = (("p50", np.median), ("max", np.max))
_FLOOR_HZ, _LEVEL_HZ = 5.0, 2.0


class ImuSamples:
    """Specific force and rate of each IMU as they are recorded; a tap."""

    def __init__(self, names: Iterable[str]) -> None:
        self._values: dict[str, list[tuple[float, ...]]] = {name: [] for name in names}

    def sample(self, port: str, sample: Sample) -> None:
        values = self._values.get(port)
        if values is not None and isinstance(sample, ImuSample) and len(values) < _MOST_SAMPLES:
            values.append((*sample.accel_mps2, *sample.gyro_radps))

    def event(self, t_ns: int, kind: str, text: str) -> None: ...

    def detected(self, client: str, detections: Detections) -> None: ...

    def array(self, name: str) -> NDArray[np.float64]:
        """Return the samples of an IMU in order, (n, 6)."""
        return np.array(self._values[name], np.float64).reshape(-1, 6)


class VibrationPart(Part):
    name = "vibration"

    def __init__(self, rates_hz: dict[str, float]) -> None:
        """`rates_hz`: of the IMUs by name."""
        self._rates_hz = rates_hz
        self._samples = ImuSamples(rates_hz)
        self._imus: dict[str, Imu] = {}

    def tap(self) -> ImuSamples:
        return self._samples

    def begin(self, run: RunContext) -> None:
        self._imus = run.sensors.imus

    def run_keys(self) -> dict[str, Any]:
        keys: dict[str, Any] = {}
        for name, imu in self._imus.items():
            levels = vibe_mps2(self._samples.array(name)[:, :3], self._rates_hz[name])
            keys[name] = {
                # Take-off and touch-down make the greatest, the rotors the median.
                "vibe_mps2": {what: _rounded(of(levels, axis=0)) for what, of in _SHOWN if len(levels)},
                "clipped_readings": list(imu.clipped_readings),
            }
        return {"vibration": keys}

    def report(self, run: RunContext) -> Report:
        drawn = {name: values for name in self._imus if len(values := self._samples.array(name)) >= _SHORTEST}
        if not drawn:
            return Report()
        from hil.run.report.vibration_pictures import vibration_pictures

        return Report(vibration_pictures(run.out, drawn, self._rates_hz))


def vibe_mps2(accel_mps2: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Return VIBE of samples (n, 3) at each of them."""
    if len(accel_mps2) == 0:
        return accel_mps2
    from scipy.signal import lfilter

    floor, level = (_share(corner_hz, rate_hz) for corner_hz in (_FLOOR_HZ, _LEVEL_HZ))
    past = (1.0 - floor) * accel_mps2[:1]  # the floor begins at the first sample, the level at 0
    slow, _ = lfilter([floor], [1.0, floor - 1.0], accel_mps2, axis=0, zi=past)
    mean: NDArray[np.float64] = lfilter([level], [1.0, level - 1.0], (accel_mps2 - slow) ** 2, axis=0)
    return np.sqrt(mean)


def _rounded(levels: NDArray[np.float64]) -> list[float]:
    return [round(float(level), 4) for level in levels]


def _share(corner_hz: float, rate_hz: float) -> float:
    """Return the share of a new sample in a low-pass: dt / (dt + RC)."""
    turn = 2.0 * math.pi * corner_hz / rate_hz
    return turn / (turn + 1.0)


def make(bench: Bench) -> Part:
    sensors = bench.config.sensors
    return VibrationPart({name: sensor.rate_hz for name, sensor in sensors.items() if sensor.kind == "imu"})
