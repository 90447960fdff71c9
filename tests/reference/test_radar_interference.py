"""Chirps of other radars: every sample against the plain equation, and the published figures of pulses and ghosts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.radar.antenna import Antenna, Pattern
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.interference import Interfered, Interference, Path, Transmission
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from sim.radar.processing.windows import window
from sim.radar.receiver import Receiver
from tests.worlds.radar_point_targets import CHIRP

PATTERN = Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=80.0, elevation_beamwidth_deg=60.0)
PLAIN: dict[str, Any] = {"conversion_gain_db": 60.0, "impedance_ohm": 50.0, "adc_full_scale_v": 1.2, "adc_bits": 12}
RECEIVER = Receiver(tx_power_dbm=5.0, **PLAIN)
FILTERED = Receiver(tx_power_dbm=5.0, hp_cutoff_hz=80e3, aaf_cutoff_hz=600e3, **PLAIN)
ANTENNA = Antenna(rx_positions_m=((0.0, 0.0, 0.0), (0.0, 0.0025, 0.0), (0.0, 0.001, 0.0025)), tx=PATTERN, rx=PATTERN)
PATH = Path(20.0, 0.0, (0.8, 0.6, 0.0), (0.96, 0.0, 0.28))
COMPLEX = CHIRP.model_copy(update={"sampling": "complex"})


def other(clock: Interference, **chirp: float) -> Transmission:
    return Transmission(CHIRP.model_copy(update=chirp), ANTENNA, RECEIVER, clock, 0.05)


def frame_of(
    transmission: Transmission, path: Path = PATH, *, t_s: float = 1.0, chirp: Chirp = CHIRP,
    receiver: Receiver = RECEIVER, clock: Interference = Interference(),  # noqa: B008
) -> NDArray[np.float64]:  # fmt: skip
    signal = np.zeros((3 * chirp.parts, chirp.chirps, chirp.samples))
    Interfered(chirp, ANTENNA, receiver, clock).add(transmission, path, t_s, signal)
    return signal


def amplitude() -> float:
    """Friis, in counts."""
    gains = [float(PATTERN.gain(np.array([d]))[0]) for d in (PATH.direction_R, PATH.direction_other_R)]
    watts = RECEIVER.tx_power_w * gains[0] * gains[1] * (CHIRP.wavelength_m / (4.0 * math.pi * PATH.range_m)) ** 2
    return RECEIVER.counts_per_sqrt_watt * math.sqrt(watts)


@pytest.mark.parametrize("chirp", [CHIRP, COMPLEX], ids=["real", "complex"])
@pytest.mark.parametrize("receiver", [RECEIVER, FILTERED], ids=["plain", "filtered"])
def test_every_sample_is_the_equation(chirp: Chirp, receiver: Receiver) -> None:
    """Both radars' phases in the longest floating point type, sample by sample and with global times."""
    clock, own = Interference(clock_ppm=1.5, clock_offset_s=3.1e-7), Interference(clock_ppm=-1.0)
    transmission = other(clock, bandwidth_hz=0.38e9, center_frequency_hz=60.798e9, repetition_s=390.9e-6)
    path = Path(20.0, 3.0, PATH.direction_R, PATH.direction_other_R)
    found = frame_of(transmission, path, t_s=0.05, chirp=chirp, receiver=receiver, clock=own)
    real, w = np.longdouble, transmission.chirp
    scale = amplitude() * w.wavelength_m / CHIRP.wavelength_m
    rate, rate_w = 1 / (1 + real("-1e-6")), 1 / (1 + real("1.5e-6"))
    expected, hits = np.zeros_like(found), 0
    for m in range(chirp.chirps):
        for n in range(chirp.samples):
            x = (n - real(chirp.samples - 1) / 2) / real(chirp.sample_rate_hz)
            local = (m - real(chirp.chirps - 1) / 2) * real(chirp.repetition_s) + x
            now = real("0.05") * rate + rate * local  # in the world
            sent = now - (real(20) + 3 * local) / real(SPEED_OF_LIGHT_MPS)
            its = (sent - real("3.1e-7")) / rate_w  # by the other's clock
            frame = np.rint(its / real("0.05"))
            u = its - frame * real("0.05")
            k = np.floor(u / real(w.repetition_s) + real(w.chirps) / 2)
            y = u - (k - real(w.chirps - 1) / 2) * real(w.repetition_s)
            if not 0 <= k < w.chirps or abs(y) > real(w.samples) / real(w.sample_rate_hz) / 2:
                continue
            slope, slope_w = (real(c.bandwidth_hz) * real(c.sample_rate_hz) / c.samples for c in (chirp, w))
            beat = float(real(chirp.center_frequency_hz) + slope * x - real(w.center_frequency_hz) - slope_w * y)
            if not (0.0 <= beat < 2e6 if chirp.parts == 2 else abs(beat) <= 1e6):
                continue
            hits += 1
            cycles = real(chirp.center_frequency_hz) * x + slope * x * x / 2
            cycles -= real(w.center_frequency_hz) * y + slope_w * y * y / 2
            h = 1.0 + 0j
            if receiver.hp_cutoff_hz is not None and receiver.aaf_cutoff_hz is not None:
                h = 1j * beat / (receiver.hp_cutoff_hz + 1j * beat) / (1 + 1j * beat / receiver.aaf_cutoff_hz)
            for r, p in enumerate(ANTENNA.rx_positions_m):
                phase = cycles - real(np.dot(p, PATH.direction_R)) / real(w.wavelength_m)
                value = scale * h * np.exp(2j * math.pi * float(phase - np.rint(phase)))
                expected[r * chirp.parts, m, n] = value.real
                if chirp.parts == 2:
                    expected[2 * r + 1, m, n] = value.imag
    assert hits > 100
    assert np.linalg.norm(found - expected) < 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("bandwidth_hz", [0.36e9, 0.38e9, 0.42e9])
def test_chirps_that_cross_are_pulses_of_the_published_length(bandwidth_hz: float) -> None:
    """2 B_IF / |S_v - S_i|, once in each chirp, and the mean power A^2 / 2 of this share of the samples."""
    rng = np.random.Generator(np.random.Philox(5))
    powers, lengths = [], []
    reach_s = 0.3 * CHIRP.sampling_s * abs(bandwidth_hz / CHIRP.bandwidth_hz - 1.0)
    for _ in range(200):
        clock = Interference(clock_offset_s=float(rng.uniform(-reach_s, reach_s)))
        signal = frame_of(other(clock, bandwidth_hz=bandwidth_hz))
        powers.append(float(np.mean(signal[0] ** 2)))
        lengths.append(float(np.count_nonzero(signal[0])) / CHIRP.chirps / CHIRP.sample_rate_hz)
    slopes = CHIRP.slope_hz_per_s, bandwidth_hz / CHIRP.sampling_s
    pulse_s = CHIRP.sample_rate_hz / abs(slopes[0] - slopes[1])
    assert np.mean(lengths) == pytest.approx(pulse_s, rel=0.05)
    expected = 0.5 * amplitude() ** 2 * pulse_s / CHIRP.sampling_s
    assert abs(10.0 * math.log10(np.mean(powers) / expected)) < 0.5


def test_the_noise_floor_rises_as_published() -> None:
    """By 1 + A^2 / 2 (share of disturbed samples) / noise^2, through the range-Doppler processing."""
    rng = np.random.Generator(np.random.Philox(6))
    deviation, frames, chirp = 3.0, 60, {"bandwidth_hz": 0.37e9, "repetition_s": 390.975e-6}
    processor = Processor(CHIRP, ANTENNA.rx_positions_m, Processing(clutter="none"))
    sums = [0.0, 0.0]
    reach_s = 0.5 * CHIRP.sampling_s * (1.0 - 0.37e9 / CHIRP.bandwidth_hz)  # crossings anywhere in a chirp
    for k in range(frames):
        noise = rng.normal(0.0, deviation, (3, CHIRP.chirps, CHIRP.samples))
        clock = Interference(clock_offset_s=float(rng.uniform(-reach_s, reach_s)))
        signal = 0.2 * frame_of(other(clock, **chirp))
        for i, x in enumerate((noise, noise + signal)):
            raw = np.floor(x + 2048.5).astype(np.uint16)
            sums[i] += float(np.mean(processor.process(raw, k, until="range_doppler").range_doppler[:, 2:-2]))
    share = CHIRP.sample_rate_hz / abs(CHIRP.bandwidth_hz - 0.37e9)  # of the samples, where chirps cross in each
    expected = 10.0 * math.log10(1.0 + 0.5 * (0.2 * amplitude()) ** 2 * share / deviation**2)
    assert expected > 2.0
    assert abs(10.0 * math.log10(sums[1] / sums[0]) - expected) < 0.5


@pytest.mark.parametrize("ppm", [0.0, 0.002, -0.003])
@pytest.mark.parametrize("lag_s", [-1.4e-8, -1.15e-8, -0.9e-8, -0.65e-8])
def test_chirps_of_one_slope_are_a_ghost(lag_s: float, ppm: float) -> None:
    """At half the way that belongs to the delay, with the speed of the clocks' drift and the power A^2."""
    signal = frame_of(other(Interference(clock_ppm=ppm, clock_offset_s=lag_s)), t_s=0.0)
    raw = np.floor(signal + 2048.5).astype(np.uint16)
    processed = Processor(CHIRP, ANTENNA.rx_positions_m, Processing(clutter="none")).process(raw, 0, until="points")
    point: Any = processed.points[0]
    assert point["range_m"] == pytest.approx(0.5 * (PATH.range_m + lag_s * SPEED_OF_LIGHT_MPS), abs=0.02)
    assert point["speed_mps"] == pytest.approx(-0.5 * ppm * 1e-6 * SPEED_OF_LIGHT_MPS, abs=0.01)
    assert point["azimuth_rad"] == pytest.approx(math.atan2(0.6, 0.8), abs=0.01)
    assert abs(10.0 * math.log10(energy_of_line(processed.range_doppler) / amplitude() ** 2)) < 0.1


def energy_of_line(power: NDArray[np.float32]) -> float:
    """Return the power of the strongest line from all of its bins.

    A line between bins is up to 1.4 dB lower in each dimension, but by Parseval the sum over its bins is always its
    power times the windows' equivalent noise bandwidths, N sum w^2 / (sum w)^2 bins (Harris, Proc. IEEE 66, 1978,
    p. 54).
    """
    row, column = np.unravel_index(int(power.argmax()), power.shape)
    rows = (int(row) + np.arange(-4, 5)) % power.shape[0]
    columns = np.arange(max(int(column) - 4, 0), min(int(column) + 5, power.shape[1]))
    bins = 1.0
    for n in (CHIRP.chirps, CHIRP.samples):
        w = np.array(window(Processing().range_window, n))
        bins *= n * float(np.sum(w**2)) / float(np.sum(w)) ** 2
    return float(np.sum(power[np.ix_(rows, columns)], dtype=np.float64)) / bins


def test_bands_apart_do_not_disturb() -> None:
    transmission = other(Interference(), center_frequency_hz=61.5e9)
    assert not np.any(frame_of(transmission))
