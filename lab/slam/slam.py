"""`hil bench slam`: errors of trajectory and map, and time of an update, in flights through training villages.

Smooth flights without an autopilot (flight.py) go from (0, 0) to (70, 60) at 10 m and 3 m/s. The bench's own VLP-16,
IMU, barometer and GPS with 1.5 m noise feed the SLAM of `rigs/jetson` as on a companion.

    villages     eight seeds, each with GPS throughout and with the GPS fix lost for 20 s
    particles    1, 5, 10, 30, 100
    decimation   every azimuth of a sweep, every 2nd, 4th, 8th
    harder       more noise of GPS, LiDAR and IMU, other heights, speeds and crowds
    ten minutes  back and forth through one village: the maps must stop growing
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from lab.slam.recording import Noise, without_gps
from lab.slam.replay import Outcome, Recording, make_recording, replay

TITLE = "SLAM: error of trajectory and map against the time of an update"
_VILLAGES = (1, 2, 3, 4, 5, 6, 7, 8)
_LOST_S = (14.0, 34.0)
_PARTICLES = (1, 5, 10, 30, 100)
_DECIMATIONS = (1, 2, 4, 8)
_DEFAULT_PARTICLES = 30
_TEN_MINUTE_LEGS = 16
_MAX_ATE_M, _MIN_SHARE, _MAX_UPDATE_S = 0.25, 0.95, 0.05
_MAX_GROWTH = 1.1

# Name -> arguments of `make_recording`.
_HARDER: dict[str, dict[str, Any]] = {
    "GPS noise 5 m, drift 3 m": {"seed": 11, "noise": Noise(seed=11, gps_m=5.0, gps_drift_m=3.0)},
    "range noise 0.05 m, 10 % lost": {
        "seed": 12,
        "noise": Noise(seed=12, range_m=0.05, lidar={"dropout_probability": 0.1}),
    },
    "IMU bias 0.2 m/s2, 0.01 rad/s": {
        "seed": 13,
        "noise": Noise(seed=13, imu={"accel_turn_on_bias_mps2": 0.2, "gyro_turn_on_bias_radps": 0.01}),
    },
    "6 m/s": {"seed": 14, "speed_mps": 6.0},
    "3 m high, 30 people": {"seed": 15, "height_m": 3.0, "parameters": {"walkers": 20, "standing_people": 10}},
    "nothing as high as the flight": {"seed": 16, "parameters": {"tall_share": 0.0}},
}


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Record flights through villages and replay them through the SLAM."""
    result = BenchmarkResult(time_label="median update [s]")
    outcomes: list[Outcome] = []
    without_fix: list[Outcome] = []
    for seed in _VILLAGES[:1] if quick else _VILLAGES:
        status(f"village {seed}: recording")
        recording = make_recording(seed)
        if not quick:
            outcomes.append(replay(recording, status=status, particles=_DEFAULT_PARTICLES))
            _add(result, "villages", recording.name, outcomes[-1])
        without_fix.append(
            replay(
                recording, frames=without_gps(recording.frames, *_LOST_S), status=status, particles=_DEFAULT_PARTICLES
            )
        )
        _add(result, "villages, GPS lost for 20 s", recording.name, without_fix[-1])
        if seed == _VILLAGES[0]:
            _sweeps(result, recording, quick=quick, status=status)
    result.checks += _checks(outcomes, without_fix)
    if quick:
        result.left_out += [
            "seven of eight villages, and all flights with GPS throughout (minutes)",
            "harder noise, heights and speeds; decimation; 5, 10 and 100 particles",
            "ten minutes of flight: whether the maps stop growing",
        ]
        return result
    for name, arguments in _HARDER.items():
        status(f"{name}: recording")
        _add(result, "harder", name, replay(make_recording(**arguments), status=status, particles=_DEFAULT_PARTICLES))
    status("ten minutes: recording")
    outcome = replay(make_recording(2, legs=_TEN_MINUTE_LEGS), status=status, particles=_DEFAULT_PARTICLES)
    _add(result, "ten minutes", "village 2", outcome)
    half = len(outcome.map_bytes) // 2
    growth = float(outcome.map_bytes[-1] / outcome.map_bytes[half])
    result.checks += [
        Check("memory of the maps after ten minutes, relative to five minutes", growth, "<=", _MAX_GROWTH, "x"),
        Check("trajectory error (ATE) over ten minutes", outcome.ate_m, "<=", _MAX_ATE_M, "m"),
    ]
    return result


def _sweeps(result: BenchmarkResult, recording: Recording, *, quick: bool, status: ShowStatus) -> None:
    for count in (1,) if quick else _PARTICLES:
        _add(result, "particles", f"particles @ {count}", replay(recording, status=status, particles=count))
    for every in () if quick else _DECIMATIONS:
        outcome = replay(recording, status=status, particles=_DEFAULT_PARTICLES, decimation=every)
        _add(result, "decimation", f"one azimuth in N @ {every}", outcome)


def _add(result: BenchmarkResult, case: str, method: str, outcome: Outcome) -> None:
    update_s = float(np.median(outcome.update_s))
    details = {
        "worst_m": outcome.worst_m,
        "p95_s": float(np.percentile(outcome.update_s, 95)),
        "wall_p95_s": float(np.percentile(outcome.wall_s, 95)),
        "map_share_within_2_cells": outcome.map_share,
        "map_mb": float(outcome.map_bytes.max() * 1e-6),
    }
    result.rows.append(Row(f"trajectory: {case}", method, outcome.ate_m, "m", update_s, details))
    result.rows.append(Row(f"map: {case}", method, outcome.map_error_m, "m", update_s, details))


def _checks(outcomes: list[Outcome], without_fix: list[Outcome]) -> list[Check]:
    checks = []
    if outcomes:
        worst = max(o.ate_m for o in outcomes)
        checks.append(Check("trajectory error (ATE), GPS noise 1.5 m, worst village", worst, "<=", _MAX_ATE_M, "m"))
    worst = max(o.ate_m for o in without_fix)
    checks.append(Check("trajectory error (ATE), GPS lost for 20 s, worst village", worst, "<=", _MAX_ATE_M, "m"))
    share = min(o.map_share for o in [*outcomes, *without_fix])
    checks.append(Check("occupied cells within 2 cells of truth, worst village", share, ">=", _MIN_SHARE, "1"))
    p95 = float(np.percentile(np.concatenate([o.update_s for o in [*outcomes, *without_fix]]), 95))
    checks.append(
        Check(
            f"update with {_DEFAULT_PARTICLES} particles, p95 of the time on one core",
            p95,
            "<=",
            _MAX_UPDATE_S,
            "s",
            "speed",
        )
    )
    return checks
