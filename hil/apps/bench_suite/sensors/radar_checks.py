"""Checks of `hil bench radar`: single points, a walking person, another vehicle, and a real recording.

- Table 3 of the AirLoop paper; range, speed, angle and amplitude of single points; superposition.
- The two scenes of the AirLoop paper through the whole chain: a person walks away to 7 m, and back. The radar is fixed
  1.8 m up, faces along the walk and takes 20 frames per second. Only the first 100 frames are counted in which the
  person is in view and walks in the wanted direction. The true range is the mean and the true speed the median over the
  pixels of the person. If there are several tracks, the one nearest in range is compared. The person counts as detected
  if this track has points in the frame and its range is less than 0.5 m off.
- Another vehicle, followed in the same way, and its radar cross-section.
- A simulated recording compared with a real one: fitted on the first half of its frames, compared on the second half.
  HIL_RADAR_RECORDING names the user's .npz or .npy file; without it this part is left out.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row
from hil.apps.bench_suite.sensors.radar_cases import RadarView, radar_parameters, radar_view, random_echoes, synthesizer
from hil.apps.bench_suite.sensors.raster_cases import View, camera_pose, looking
from sim.frame.camera_model import CameraModel
from sim.frame.mount import quaternion_of_rpy
from sim.frame.source import VEHICLE_CLASS
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_bodies import VehicleBodies, with_vehicles
from sim.radar.adc import RadarReceiverChain
from sim.radar.antenna import Antenna, Pattern
from sim.radar.calibration import calibrate
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.comparison import compare
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.radar.processing.processor import Processor
from sim.radar.recording import load_recording
from sim.radar.synthesis import Synthesizer
from sim.scene.scene import Scene, load_scene
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world

Float64 = NDArray[np.float64]
RECORDING = "HIL_RADAR_RECORDING"
_ADC_CENTRE = 2048.0  # centre of the ADC's range [counts]
_AMPLITUDE = 100.0  # counts
_PERIOD_NS = 50_000_000
_HEIGHT_M = 1.8
_COUNTED_FRAMES = 100  # of each walk
_WARM_UP_FRAMES = 20  # not counted
_MIN_SPEED_MPS = 0.5  # a slower person is turning round
_VEHICLE_FRAMES, _VEHICLE_MPS = 60, 0.8
_HOVER_RADPS = (530.0,) * 4
_REST = (0.0, 0.0, 0.0)
_MAX_FRAMES = 600
_GATE_M = 0.5


def characteristic_checks() -> list[Check]:
    """Return checks against table 3 of the AirLoop paper, to half of the last digit. Its d_res assumes c = 3e8 m/s."""
    chirp = radar_parameters().chirp
    paper_c = 3e8 / SPEED_OF_LIGHT_MPS
    checks = []
    for name, value, printed, half_digit, unit in (
        ("v_max", chirp.max_speed_mps, 3.15, 0.005, "m/s"),
        ("v_res", chirp.speed_resolution_mps, 0.1, 0.05, "m/s"),
        ("d_res, with the paper's c", paper_c * chirp.range_resolution_m, 0.375, 0.0005, "m"),
        ("d_max", chirp.max_range_m, 12.0, 0.5, "m"),
    ):
        checks.append(Check(f"{name}, off table 3 ({printed:g} {unit})", abs(value - printed), "<=", half_digit, unit))
    return checks


def target_checks(*, quick: bool) -> list[Check]:
    """Return checks of point targets after processing, of the amplitude law, and of superposition (direct method)."""
    p = radar_parameters()
    rng = np.random.Generator(np.random.Philox(5))
    worst = {"range": 0.0, "speed": 0.0, "azimuth": 0.0, "elevation": 0.0}
    missed = 0
    processor = Processor(p.chirp, p.antenna.array, p.processing)
    farthest_m = p.chirp.max_range_m - 1.75 * p.chirp.range_resolution_m  # no peak in the last bin: see PeakFinder
    for _ in range(40 if quick else 400):
        processor.reset()
        range_m = rng.uniform(1.5, farthest_m)
        speed = rng.uniform(0.4, 0.96 * p.chirp.max_speed_mps) * rng.choice([-1.0, 1.0])
        azimuth, elevation = np.deg2rad(rng.uniform(-50.0, 50.0)), np.deg2rad(rng.uniform(-30.0, 30.0))
        points = processor.process(_digitised(p, [(range_m, speed, azimuth, elevation)]), 0, until="points").points
        if len(points) == 0:
            missed += 1
            continue
        strongest = points[int(np.argmax(points["snr_db"]))]
        worst["range"] = max(worst["range"], abs(float(strongest["range_m"]) - range_m) / p.chirp.range_resolution_m)
        worst["speed"] = max(worst["speed"], abs(float(strongest["speed_mps"]) - speed) / p.chirp.speed_resolution_mps)
        worst["azimuth"] = max(worst["azimuth"], abs(math.degrees(float(strongest["azimuth_rad"]) - azimuth)))
        worst["elevation"] = max(worst["elevation"], abs(math.degrees(float(strongest["elevation_rad"]) - elevation)))
    return [
        Check("point targets that are not detected", float(missed), "<=", 0.0, "1"),
        Check("point targets: range", worst["range"], "<=", 0.05, "bins"),
        Check("point targets: speed", worst["speed"], "<=", 0.05, "bins"),
        Check("point targets: azimuth", worst["azimuth"], "<=", 0.5, "degrees"),
        Check("point targets: elevation", worst["elevation"], "<=", 0.5, "degrees"),
        Check(
            "superposition: signal of two sets of echoes and sum of their signals, direct method",
            _superposition_error(p),
            "<=",
            1e-12,
            "1",
        ),
        Check(
            "amplitude law: a sphere at 5 to 80 m, difference from the closed form",
            _amplitude_law_error_db(p),
            "<=",
            0.1,
            "dB",
        ),
    ]


def direction(azimuth_rad: float, elevation_rad: float) -> Float64:
    """Return the unit vector of a direction in the radar's frame R."""
    c = math.cos(elevation_rad)
    return np.array([c * math.cos(azimuth_rad), c * math.sin(azimuth_rad), math.sin(elevation_rad)])


def _digitised(p: RadarParameters, targets: list[tuple[float, float, float, float]]) -> NDArray[np.uint16]:
    """Return the frame of an ideal receiver; a target is range [m], speed [m/s], azimuth and elevation [rad]."""
    directions = np.array([direction(azimuth, elevation) for _, _, azimuth, elevation in targets])
    echoes = Echoes(
        np.array([t[0] for t in targets]),
        np.array([t[1] for t in targets]),
        directions,
        np.full(len(targets), _AMPLITUDE),
    )
    return np.rint(_exact(p, echoes) + _ADC_CENTRE).astype(np.uint16)


def _exact(p: RadarParameters, echoes: Echoes) -> Float64:
    out = np.empty(p.raw_shape)
    Synthesizer(p.chirp, p.antenna.array, hp_cutoff_hz=None, aaf_cutoff_hz=None, method="direct").synthesize(
        echoes, out
    )
    return out


def _amplitude_law_error_db(p: RadarParameters) -> float:
    """Return the deviation of a rendered rough sphere's echo power from the radar equation.

    The cross-section is (8/3) pi r^2, and the effective range is that of the centre less 3/4 of the radius. Antenna
    patterns of 179 degrees keep the gain constant across the picture.
    """
    wide = Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=179.0, elevation_beamwidth_deg=179.0)
    antenna = Antenna(rx_positions_m=((0.0, 0.0, 0.0),), tx=wide, rx=wide)
    receiver = p.receiver
    scale = receiver.counts_per_sqrt_watt**2 * receiver.tx_power_w * wide.axis_gain**2 * p.chirp.wavelength_m**2
    rough = {"lidar_reflectivity": 0.5, "relative_permittivity": 1.0, "conductivity_s_per_m": 1e8, "roughness_m": 0.05}
    worst = 0.0
    for range_m in (5.0, 20.0, 80.0):
        radius_m = range_m / 250.0
        sphere = f'<geom pos="{range_m} 0 0" size="{radius_m}" material="m"/>'
        xml = f'<mujoco><asset><material name="m"/></asset><worldbody>{sphere}</worldbody></mujoco>'
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sphere.xml"
            path.write_text(xml)
            airfield = load_scene("airfield").model_dump()
            world = load_world(
                Scene.model_validate(
                    airfield | {"name": "sphere", "map": {"mjcf": str(path), "surfaces": {"m": rough}}}
                )
            )
        camera = CameraModel.from_fov(320, 240, math.degrees(6.0 * radius_m / range_m))
        radar = radar_view(world, p.model_copy(update={"antenna": antenna}), camera=camera)
        view = View(0, camera_pose(np.zeros(3), looking(0.0, 0.0)))
        radar.draw(view)
        power = float(np.sum(radar.echoes(view).amplitude ** 2))
        section_m2 = 8.0 / 3.0 * math.pi * radius_m**2
        expected = scale / (4.0 * math.pi) ** 3 * section_m2 / (range_m - 0.75 * radius_m) ** 4
        worst = max(worst, abs(10.0 * math.log10(power / expected)))
    return worst


def _superposition_error(p: RadarParameters) -> float:
    a, b = random_echoes(500, seed=7), random_echoes(300, seed=8)
    joined = Echoes(*(np.concatenate(pair) for pair in zip(_arrays(a), _arrays(b), strict=True)))
    joined_signal = _exact(p, joined)
    return float(np.linalg.norm(joined_signal - _exact(p, a) - _exact(p, b)) / np.linalg.norm(joined_signal))


def _arrays(e: Echoes) -> tuple[Float64, Float64, Float64, Float64]:
    return e.range_m, e.speed_mps, e.direction_R, e.amplitude


def person_checks(result: BenchmarkResult, *, quick: bool) -> list[Check]:
    """Return checks of detection, range and speed in both walks, with several seeds of the noise."""
    parameters = radar_parameters()
    radar = radar_view(load_world(load_scene("radar_range")), parameters, "instance")
    person = next(i for i, name in enumerate(radar.world.instance_names) if name.startswith("person"))
    checks: list[Check] = []
    for walk, sign in (("away", 1.0), ("towards", -1.0)):
        checks += _follow_checks(result, f"person walks {walk}", radar, parameters, _Target(person, sign), quick=quick)
    return checks


def vehicle_checks(result: BenchmarkResult, *, quick: bool) -> list[Check]:
    """Return the same checks for an x500 that flies 1.5 to 4.7 m ahead, and checks of its radar cross-section."""
    parameters = radar_parameters()
    vehicle = load_vehicle("x500")
    world = with_vehicles(load_world(load_scene("airfield")), {"x500": vehicle})
    radar = radar_view(world, parameters, "instance")
    actor = world.map.actors[-1]
    assert isinstance(actor, VehicleBodies)
    checks: list[Check] = []
    for way, sign in (("away", 1.0), ("towards", -1.0)):
        target = _Target(len(world.instance_names) - 1, sign, _VEHICLE_FRAMES, partial(_fly, actor, sign))
        checks += _follow_checks(result, f"x500 flies {way}", radar, parameters, target, quick=quick)
    section_dbsm = cross_section_dbsm("x500", views=24 if quick else 120)
    # Means of five drones at 24 GHz, Phantom 3 to Matrice 600: IEICE Communications Express 9 (2020) no. 7, p. 262-267.
    return [
        *checks,
        Check("x500, mean radar cross-section: least of five measured drones", section_dbsm, ">=", -19.1, "dBsm"),
        Check("x500, mean radar cross-section: greatest of five measured drones", section_dbsm, "<=", -8.1, "dBsm"),
    ]


def cross_section_dbsm(name: str, *, views: int) -> float:
    """Return the mean cross-section of a vehicle seen from all sides in level flight, tilted by 8 degrees rms."""
    p, world = radar_parameters(), with_vehicles(load_world(load_scene("airfield")), {name: load_vehicle(name)})
    p = p.model_copy(update={"mask": Mask(classes=(VEHICLE_CLASS,))})
    radar = radar_view(world, p, camera=CameraModel.from_fov(320, 240, 12.0))
    actor = world.map.actors[-1]
    assert isinstance(actor, VehicleBodies)
    rng = np.random.Generator(np.random.Philox(6))
    wavelength2, gains = p.chirp.wavelength_m**2, p.antenna.tx.axis_gain * p.antenna.rx.axis_gain
    scale = p.receiver.counts_per_sqrt_watt**2 * p.receiver.tx_power_w * gains * wavelength2 / (4.0 * math.pi) ** 3
    total_m2 = 0.0
    for k in range(views):
        view = View((k + 1) * _PERIOD_NS, camera_pose(np.array([0.0, 0.0, 30.0]), looking(0.0, 0.0)))
        roll, pitch = rng.normal(0.0, 8.0, 2).tolist()
        q = quaternion_of_rpy((roll, pitch, 360.0 * k / views))
        actor.place_at(view.t_ns, (5.0, 0.0, 30.0), q, _REST, _REST, _HOVER_RADPS)
        radar.draw(view)
        echoes = radar.echoes(view)
        total_m2 += float(np.sum(echoes.amplitude**2 * echoes.range_m**4)) / scale / views
    return 10.0 * math.log10(total_m2)


@dataclass(frozen=True)
class _Target:
    """Instance that a radar follows while it moves away (sign 1) or nearer (-1); `place` gives its state at a frame."""

    instance: int
    sign: float
    frames: int = _COUNTED_FRAMES
    place: Callable[[int], None] | None = None  # None: an actor of the map


def _fly(actor: VehicleBodies, sign: float, k: int) -> None:
    """Place the vehicle at frame `k`: 1.5 m ahead at the beginning or the end of its flight."""
    frame = k if sign > 0.0 else _WARM_UP_FRAMES + _VEHICLE_FRAMES - k
    x_m = 1.5 + _VEHICLE_MPS * frame * _PERIOD_NS * 1e-9
    tilt = quaternion_of_rpy((0.0, 5.0, 30.0))
    actor.place_at(
        k * _PERIOD_NS, (x_m, 0.2, _HEIGHT_M + 0.3), tilt, (sign * _VEHICLE_MPS, 0.0, 0.0), _REST, _HOVER_RADPS
    )


def _follow_checks(
    result: BenchmarkResult, name: str, radar: RadarView, p: RadarParameters, target: _Target, *, quick: bool
) -> list[Check]:
    detected, range_error, speed_error, seconds = [], [], [], []
    for seed in (1,) if quick else (1, 2, 3):
        share, range_errors, speed_errors, frame_s = _follow(radar, p, target, seed)
        detected.append(share)
        range_error += range_errors
        speed_error += speed_errors
        seconds.append(frame_s)
    result.rows.append(Row(name, "whole chain", float(np.max(range_error)), "m of range", float(np.mean(seconds))))
    return [
        Check(f"{name}: frames in which it is detected", 100.0 * min(detected), ">=", 95.0, "%"),
        Check(f"{name}: range error, 95 % of frames", float(np.quantile(range_error, 0.95)), "<=", 0.2, "m"),
        Check(f"{name}: speed error, 95 % of frames", float(np.quantile(speed_error, 0.95)), "<=", 0.15, "m/s"),
        Check(f"{name}: range error, rms", float(np.sqrt(np.mean(np.square(range_error)))), "<=", 0.2, "m"),
        Check(f"{name}: speed error, rms", float(np.sqrt(np.mean(np.square(speed_error)))), "<=", 0.15, "m/s"),
    ]


def _follow(
    radar: RadarView, p: RadarParameters, target: _Target, seed: int
) -> tuple[float, list[float], list[float], float]:
    """Return the share of frames with a detection, range [m] and speed [m/s] errors, and seconds per frame."""
    transform = synthesizer(p, "nufft", p.tolerance)
    chain = RadarReceiverChain(p.chirp, p.impairments, p.raw_shape[0], seed=seed, name="radar")
    processor = Processor(p.chirp, p.antenna.array, p.processing)
    signal, raw = np.empty(p.raw_shape), np.empty(p.raw_shape, np.uint16)
    pose = camera_pose(np.array([0.0, 0.0, _HEIGHT_M]), looking(0.0, 0.0))
    counted, tracked, began = 0, 0, time.perf_counter()
    range_error: list[float] = []
    speed_error: list[float] = []
    for k in range(_MAX_FRAMES):
        view = View(k * _PERIOD_NS, pose)
        if target.place is not None:
            target.place(k)
        radar.draw(view)
        transform.synthesize(radar.echoes(view), signal)
        chain.digitise(signal, k, raw)
        tracks = processor.process(raw, view.t_ns).tracks
        pixels = radar.picture["instance"] == target.instance
        if not pixels.any():
            continue
        truth_m = float(radar.picture["range"][pixels].mean())
        truth_mps = float(np.median(radar.picture["radial_velocity"][pixels]))
        if k < _WARM_UP_FRAMES or truth_mps * target.sign < _MIN_SPEED_MPS:
            continue
        counted += 1
        if len(tracks):
            nearest = tracks[int(np.argmin(np.abs(tracks["range_m"] - truth_m)))]
            tracked += bool(nearest["unseen_s"] == 0.0 and abs(nearest["range_m"] - truth_m) < _GATE_M)
            range_error.append(abs(float(nearest["range_m"]) - truth_m))
            speed_error.append(abs(float(nearest["speed_mps"]) - truth_mps))
        if counted == target.frames:
            break
    return tracked / counted, range_error or [np.inf], speed_error or [np.inf], (time.perf_counter() - began) / (k + 1)


def recording_checks(result: BenchmarkResult) -> list[Check]:
    """Return checks of a simulated recording against a real one: noise, share of odd ADC values, correlations (NCC)."""
    file = os.environ.get(RECORDING)
    if not file:
        result.left_out.append(f"a real recording: set {RECORDING} to its file")
        return []
    recording = load_recording(Path(file))
    half = recording.frames // 2
    # No scene is simulated here, so `keep_echoes` counts static reflectors as part of the constant background.
    fitted = calibrate(recording, frames=(0, half), keep_echoes=True, where=file)
    real = recording.adc[half:]
    chain = RadarReceiverChain(recording.chirp, fitted.impairments, real.shape[1], seed=1, name="radar")
    no_echoes, simulated = np.zeros(real.shape[1:]), np.empty(real.shape, np.uint16)
    for k in range(len(real)):
        chain.digitise(no_echoes, k, simulated[k])
    comparison = compare(simulated, real)
    checks = []
    for name, ncc in comparison.ncc.items():
        values = f"{ncc.simulated_against_real:.3f} simulated to real, {ncc.real_against_real:.3f} real to real"
        checks.append(Check(f"NCC {name}: {values}: difference", abs(ncc.difference), "<=", 0.02, "1"))
    simulated_odd, real_odd = comparison.odd_code_share
    return [
        *checks,
        Check("noise power, worst bin", float(np.abs(comparison.noise_power_db).max()), "<=", 0.5, "dB"),
        Check("range-Doppler noise", float(np.abs(comparison.range_doppler_noise_db).max()), "<=", 0.5, "dB"),
        Check(
            f"share of odd ADC values, difference from the recording's ({real_odd:.3f})",
            abs(simulated_odd - real_odd),
            "<=",
            0.02,
            "1",
        ),
    ]
