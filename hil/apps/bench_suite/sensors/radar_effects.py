"""Part of `hil bench radar`: what else is in a frame, each with its error beside its time.

interference     mean power of crossing chirps over random clocks, against A^2 / 2 (2 B_IF / |S - S'|) / T
rain             mean power of a frame's drops in each metre, against the volume's; time of a frame's drops
sweep            sidebands of phase noise, against 4 L(f) sin^2(pi f tau); time with the sum of the derivatives
"""

from __future__ import annotations

import math

import numpy as np

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.radar_cases import PIXELS, radar_parameters, random_echoes, synthesizer
from hil.apps.bench_suite.timing import best_times
from sim.frame.camera_model import CameraModel
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.echoes import Echoes
from sim.radar.interference import Interfered, Interference, Path, Transmission
from sim.radar.rain import Rain
from sim.radar.scatterers import Scatterers, amplitude_scale, solid_angles
from sim.radar.sweep_errors import Sweep, SweepErrors
from sim.scene.scene import load_scene
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world

_LIMIT_DB = 0.5
_PHASE_NOISE = ((1e4, -70.0), (1e5, -80.0), (1e6, -97.0))  # of the order of a 60 GHz chip's


def effect_rows(result: BenchmarkResult, *, quick: bool, status: ShowStatus) -> None:
    """Add rows and checks of interference, rain and errors of the sweep."""
    p = radar_parameters()
    frames = 60 if quick else 300
    for name, measure in (("interference", _interference), ("rain, 10 mm/h", _rain), ("phase noise", _phase_noise)):
        status(name)
        error_db, time_s, details = measure(p, frames)
        result.rows.append(Row(name, f"{frames} frames", error_db, "dB of mean power", time_s, details))
        result.checks.append(Check(f"{name}: power against its formula", error_db, "<=", _LIMIT_DB, "dB"))


def _interference(p: RadarParameters, frames: int) -> tuple[float, float, dict[str, float]]:
    receiver = p.receiver.model_copy(update={"hp_cutoff_hz": None, "aaf_cutoff_hz": None})
    victim = Interfered(p.chirp, p.antenna, receiver, Interference())
    other_chirp = p.chirp.model_copy(update={"bandwidth_hz": 0.95 * p.chirp.bandwidth_hz})
    path = Path(20.0, 0.0, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    rng = np.random.Generator(np.random.Philox(3))
    reach_s = 0.3 * 0.05 * p.chirp.sampling_s  # crossings within the chirp
    power, times_s, signal = 0.0, [], np.zeros(p.raw_shape)
    for _ in range(frames):
        clock = Interference(clock_offset_s=float(rng.uniform(-reach_s, reach_s)))
        other = Transmission(other_chirp, p.antenna, receiver, clock, 0.05)
        signal[:] = 0.0
        took = best_times({"": lambda other=other: victim.add(other, path, 1.0, signal)}, rounds=1)[""]  # type: ignore[misc]
        power += float(np.mean(signal**2)) / frames
        times_s.append(took)
    share = p.chirp.sample_rate_hz / (0.05 * p.chirp.slope_hz_per_s) / p.chirp.sampling_s
    other = Transmission(other_chirp, p.antenna, receiver, Interference(), 0.05)
    expected = 0.5 * victim.amplitude(other, path) ** 2 * share
    return abs(10.0 * math.log10(power / expected)), float(np.median(times_s)), {"disturbed_share": share}


def _rain(p: RadarParameters, frames: int) -> tuple[float, float, dict[str, float]]:
    camera = CameraModel.from_fov(320, 240, 90.0)
    made = Scatterers(camera, load_world(load_scene("airfield")), p.chirp, p.antenna, p.receiver)
    far_m = p.chirp.max_range_m
    rain = Rain(p.chirp.center_frequency_hz, 10.0, made.direction_R, made.weight, far_m, seed=1, name="radar")
    sky, down = np.full((240, 320), np.inf, np.float32), (0.0, 0.0, -1.0)
    metres = int(far_m)
    power = np.zeros(metres + 1)
    for k in range(frames):
        e = rain.echoes(sky, down, (0.0, 0.0, 0.0), k)
        power += np.bincount(e.range_m.astype(int), e.amplitude**2, metres + 1) / frames
    pattern = float(np.sum(p.antenna.share(made.direction_R) * solid_angles(camera).reshape(-1)))
    scale2 = amplitude_scale(p.chirp, p.antenna, p.receiver) ** 2 * rain.eta_per_m * pattern
    worst = max(
        abs(10.0 * math.log10(power[m] / (scale2 * (1.0 / m - 1.0 / (m + 1))))) for m in range(1, metres)
    )  # fmt: skip
    many = random_echoes(PIXELS)

    def frame() -> None:
        rain.echoes(sky, down, (0.0, 0.0, 0.0), 0)
        rain.attenuate(many)

    return worst, best_times({"": frame}, rounds=5)[""], {"eta_per_m": rain.eta_per_m}


def _phase_noise(p: RadarParameters, frames: int) -> tuple[float, float, dict[str, float]]:
    chirp = p.chirp.model_copy(update={"sampling": "complex"})
    sweep, range_m, n = Sweep(phase_noise=_PHASE_NOISE), 6.0, chirp.samples
    receiver = p.receiver.model_copy(update={"hp_cutoff_hz": None, "aaf_cutoff_hz": None})
    errors = SweepErrors(chirp, p.antenna.array, receiver, sweep, seed=1, name="radar")
    echo = Echoes(np.array([range_m]), np.zeros(1), np.array([[1.0, 0.0, 0.0]]), np.array([100.0]))
    carrier = np.zeros((2 * len(p.antenna.rx_positions_m), chirp.chirps, n))
    plain = p.model_copy(update={"chirp": chirp, "receiver": receiver})
    synthesizer(plain, "direct", 1e-3).synthesize(echo, carrier)
    x = carrier[0] + 1j * carrier[1]
    power = np.zeros(n)
    for seq in range(frames):
        added = np.zeros_like(carrier)
        errors.add(echo, added, seq)
        power += np.mean(np.abs(np.fft.fft((added[0] + 1j * added[1]) / x, axis=1) / n) ** 2, axis=0) / frames
    step_hz, tau = chirp.sample_rate_hz / n, 2.0 * range_m / SPEED_OF_LIGHT_MPS
    worst = 0.0
    for b in range(1, n // 2 - 1):
        f = b * step_hz
        expected = 4.0 * sweep.noise_at(f) * math.sin(math.pi * f * tau) ** 2 * step_hz
        worst = max(worst, abs(10.0 * math.log10(0.5 * (power[b] + power[n - b]) / expected)))
    real = SweepErrors(p.chirp, p.antenna.array, p.receiver, sweep, seed=1, name="radar")
    many, signal = random_echoes(PIXELS), np.zeros(p.raw_shape)
    time_s = best_times({"": lambda: real.add(many, signal, 0)}, rounds=3)[""]
    return worst, time_s, {"echoes": float(PIXELS)}
