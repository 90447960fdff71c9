"""The paper's two radar scenes, through the whole chain: a person walks away to 7 m, and towards the radar again.

The radar stands still at 1.8 m and looks along the walk; 20 frames a second. A frame counts from where the person
walks in that direction within range; 100 frames each. Truth: range, mean over the pixels that show the person; speed,
their median. Of several tracks the one nearest in range is taken for the person. The person counts as detected where
this track has points of the frame itself and is not farther off than 0.5 m.
"""

from __future__ import annotations

import time

import numpy as np

from hil.bench_suite.radar_cases import RadarView, radar_parameters, radar_view, synthesizer
from hil.bench_suite.raster_cases import View, camera_pose, looking
from hil.bench_suite.result import BenchmarkResult, Check, Row
from sim.radar.adc import RadarReceiverChain
from sim.radar.processing.processor import Processor
from sim.scene.scene import load_scene
from sim.scene.world import load_world
from sim.sensors.radar_parameters import RadarParameters

_PERIOD_NS = 50_000_000
_HEIGHT_M = 1.8
_FRAMES = 100  # of each walk
_WARM_UP = 20  # frames before the first that counts, as a radar that has been on for a while
_WALKS_MPS = 0.5  # slower is turning round
_LONGEST = 600  # frames
_GATE_M = 0.5


def person_checks(result: BenchmarkResult, *, quick: bool) -> list[Check]:
    """Detection, range and speed, both walks; seeds of the noise."""
    checks: list[Check] = []
    parameters = radar_parameters()
    radar = radar_view(load_world(load_scene("radar_range")), parameters, "instance")
    for walk, sense in (("away", 1.0), ("towards", -1.0)):
        seen, range_error, speed_error, seconds = [], [], [], []
        for seed in (1,) if quick else (1, 2, 3):
            found = _walk(radar, parameters, sense, seed)
            seen.append(found[0])
            range_error += found[1]
            speed_error += found[2]
            seconds.append(found[3])
        name = f"person walks {walk}"
        result.rows.append(Row(name, "whole chain", float(np.max(range_error)), "m of range", float(np.mean(seconds))))
        checks += [
            Check(f"{name}: frames in which it is detected", 100.0 * min(seen), ">=", 95.0, "%"),
            Check(f"{name}: range error, 95 % of frames", float(np.quantile(range_error, 0.95)), "<=", 0.2, "m"),
            Check(f"{name}: speed error, 95 % of frames", float(np.quantile(speed_error, 0.95)), "<=", 0.15, "m/s"),
            Check(f"{name}: range error, rms", float(np.sqrt(np.mean(np.square(range_error)))), "<=", 0.2, "m"),
            Check(f"{name}: speed error, rms", float(np.sqrt(np.mean(np.square(speed_error)))), "<=", 0.15, "m/s"),
        ]
    return checks


def _walk(
    radar: RadarView, p: RadarParameters, sense: float, seed: int
) -> tuple[float, list[float], list[float], float]:
    """Share of frames with a track, errors of those, seconds a frame."""
    made = synthesizer(p, "nufft", p.tolerance)
    n_rx = len(p.antenna.rx_positions_m)
    chain = RadarReceiverChain(p.chirp, p.impairments, n_rx, seed=seed, name="radar")
    processor = Processor(p.chirp, p.antenna.rx_positions_m, p.processing)
    shape = (n_rx, p.chirp.chirps, p.chirp.samples)
    signal, raw = np.empty(shape), np.empty(shape, np.uint16)
    pose = camera_pose(np.array([0.0, 0.0, _HEIGHT_M]), looking(0.0, 0.0))
    person = next(i for i, name in enumerate(radar.world.instance_names) if name.startswith("person"))
    counted, tracked, began = 0, 0, time.perf_counter()
    range_error: list[float] = []
    speed_error: list[float] = []
    for k in range(_LONGEST):
        view = View(k * _PERIOD_NS, pose)
        radar.draw(view)
        made.synthesize(radar.echoes(view), signal)
        chain.digitise(signal, k, raw)
        tracks = processor.process(raw, view.t_ns).tracks
        mine = radar.picture["instance"] == person
        if not mine.any():
            continue
        truth_m = float(radar.picture["range"][mine].mean())
        truth_mps = float(np.median(radar.picture["radial_velocity"][mine]))
        if k < _WARM_UP or truth_mps * sense < _WALKS_MPS:
            continue
        counted += 1
        if len(tracks):
            best = tracks[int(np.argmin(np.abs(tracks["range_m"] - truth_m)))]
            tracked += bool(best["unseen_s"] == 0.0 and abs(best["range_m"] - truth_m) < _GATE_M)
            range_error.append(abs(float(best["range_m"]) - truth_m))
            speed_error.append(abs(float(best["speed_mps"]) - truth_mps))
        if counted == _FRAMES:
            break
    return tracked / counted, range_error or [np.inf], speed_error or [np.inf], (time.perf_counter() - began) / (k + 1)
