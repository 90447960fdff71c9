"""A real IWR6843 before a room, captured with a DCA1000: order of samples, places of antennas, noise, and a simulation.

The capture is one frame of three transmitters, 85 loops and 512 samples, with mmWave Studio's settings. It is not part
of this project: HIL_RADAR_TI_RECORDING names its .bin, or it lies in ../shared/radar/iwr6843 beside the checkout. Its
ramp ends with its last sample, and the last three samples are no signal: figures of noise leave eight out.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.radar.dca1000_source import open_capture
from sim.radar.adc import RadarReceiverChain
from sim.radar.comparison import correlations
from sim.radar.impairments import Impairments, Leakage, ReceiverNoise
from sim.radar.spectra import noise_power, range_doppler, range_doppler_noise
from sim.radar.swept_pattern import SweptPattern
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters

VARIABLE = "HIL_RADAR_TI_RECORDING"
DEFAULT = Path(__file__).resolve().parents[2].parent / "shared" / "radar" / "iwr6843" / "adc_data.bin"
LOOPS, TRANSMITTERS, RECEIVERS = 85, 3, 4
KEPT = 504  # samples before the end of the ramp
HALF = 42  # loops
FIRST_BIN = 18  # 0.7 m, past the leakage

Complex = NDArray[np.complex128]
Float64 = NDArray[np.float64]


@cache
def capture() -> tuple[RadarParameters, NDArray[np.uint16]]:
    """Return the settings, and codes (transmitters, channels, loops, samples)."""
    path = Path(os.environ.get(VARIABLE) or DEFAULT)
    if not path.exists():
        pytest.skip(f"no capture of a real radar: {VARIABLE} names none and ../shared/radar/iwr6843 has none")
    source = open_capture(path, preset=None, texts=())
    raw = next(source.frames).raw
    return source.parameters, raw.reshape(2 * RECEIVERS, LOOPS, TRANSMITTERS, -1).transpose(2, 0, 1, 3)


def as_complex(codes: NDArray[np.uint16]) -> Complex:
    x = codes.astype(np.float64) - 32768.0
    return np.asarray(x[:, 0::2] + 1j * x[:, 1::2])


def at_rest(x: Complex) -> Complex:
    """Return the mean spectra over range of static objects (channels, bins), transmitter by transmitter."""
    window = np.hanning(x.shape[-1])
    x = x - x.mean(axis=(2, 3), keepdims=True)
    spectra = np.fft.fft(x * window, axis=-1).mean(axis=2) / window.sum()
    return np.asarray(spectra.reshape(-1, x.shape[-1]))


def strongest(amplitude: Float64, count: int) -> list[int]:
    inner = amplitude[1:-1]
    peaks = np.flatnonzero((inner > amplitude[:-2]) & (inner >= amplitude[2:])) + 1
    peaks = peaks[(peaks >= FIRST_BIN) & (peaks < 500)]
    return sorted(peaks.tolist(), key=lambda b: -amplitude[b])[:count]


def images_db(spectra: Complex) -> Float64:
    """Return the power of the eight strongest reflectors over that at the negative frequency."""
    amplitude = np.sqrt((np.abs(spectra) ** 2).mean(axis=0))
    n = len(amplitude)
    return 20.0 * np.log10(np.array([amplitude[b] / amplitude[n - b] for b in strongest(amplitude, 8)]))


def test_the_order_of_samples() -> None:
    """Complex samples have one sideband: reflectors have no image, as they would in any other order."""
    p, codes = capture()
    found = images_db(at_rest(as_complex(codes)))
    words = codes.transpose(2, 0, 1, 3)[..., :].reshape(LOOPS, TRANSMITTERS, RECEIVERS, 2, -1, 2)
    pairs = words.transpose(1, 2, 0, 4, 3, 5).astype(np.float64) - 32768.0  # as in the file: I I Q Q
    alternating = pairs.reshape(TRANSMITTERS, RECEIVERS, LOOPS, p.chirp.samples, 2)  # as if I Q I Q
    wrong = images_db(at_rest(np.asarray(alternating[..., 0] + 1j * alternating[..., 1])))
    print(f"images of the strongest reflectors: {found.round(1)} dB below them; in the order I Q: {wrong.round(1)}")
    assert found.min() > 15.0
    assert wrong.max() < 10.0


def coherence(positions_m: Float64, wavelength_m: float, fitted: Complex, judged: Complex) -> tuple[float, Float64]:
    """Return the share of power that plane waves on the array explain, and the phases of the channels [rad].

    Phases of the channels are fitted to some reflectors, and others are judged; directions are free for each.
    """
    y, z = (v.reshape(-1) for v in np.meshgrid(np.linspace(-0.95, 0.95, 96), np.linspace(-0.8, 0.8, 65)))
    ahead = y * y + z * z < 0.98
    path = positions_m[:, 1:2] * y[ahead] + positions_m[:, 2:3] * z[ahead]
    waves = np.exp(-2j * np.pi / wavelength_m * path).T
    gain = np.ones(len(positions_m), np.complex128)
    for _ in range(30):
        seen = (fitted * gain.conj()) @ waves.conj().T
        best = np.abs(seen).argmax(axis=1)
        strength = seen[np.arange(len(best)), best]
        gain = (fitted * (waves[best] * (strength / np.abs(strength))[:, None]).conj()).sum(axis=0)
        gain /= np.abs(gain)
    share = np.abs((judged * gain.conj()) @ waves.conj().T) ** 2 / len(positions_m)
    return float(share.max(axis=1).mean()), np.angle(gain * gain[0].conj())


def test_the_places_of_the_antennas() -> None:
    """The preset's places explain the phases of reflectors better than others, with receivers' phases that repeat."""
    p, codes = capture()
    spectra = at_rest(as_complex(codes))
    bins = strongest(np.sqrt((np.abs(spectra) ** 2).mean(axis=0)), 24)
    vectors = (spectra[:, bins] / np.linalg.norm(spectra[:, bins], axis=0)).T
    rx, tx = np.array(p.antenna.rx_positions_m), np.array(p.antenna.tx_positions_m)

    def share(t: Float64, r: Float64) -> tuple[float, Float64]:
        positions = (t[:, None] + r[None]).reshape(-1, 3)
        return coherence(positions, p.chirp.wavelength_m, vectors[0::2], vectors[1::2])

    ours, phase = share(tx, rx)
    by_receiver = phase.reshape(TRANSMITTERS, RECEIVERS)
    by_receiver = np.degrees(by_receiver - by_receiver[:, :1])
    print(f"explained: {ours:.2f}; phases of the receivers [deg], by transmitter: {by_receiver.round(0).tolist()}")
    assert ours > 0.7
    assert np.ptp(by_receiver, axis=0).max() < 10.0
    ods = PRESETS["iwr6843ods"].parameters
    assert isinstance(ods, RadarParameters)
    others = {
        "TX2 and TX3 exchanged": share(tx[[0, 2, 1]], rx)[0],
        "receivers from the other side": share(tx, rx[::-1])[0],
        "TX2 in the row": share(tx * [1.0, 1.0, 0.0], rx)[0],
        "iwr6843ods": share(np.array(ods.antenna.tx_positions_m), np.array(ods.antenna.rx_positions_m))[0],
    }
    print("others: " + ", ".join(f"{name} {value:.2f}" for name, value in others.items()))
    assert max(others.values()) < ours - 0.05


def test_noise_beside_the_preset() -> None:
    """Noise of each receiver, in counts^2 of one channel, beside white noise of the preset's density."""
    p, codes = capture()
    x = as_complex(codes)[..., :480]
    x = x - x.mean(axis=2, keepdims=True)
    fast, slow = np.hanning(480), np.hanning(LOOPS)
    spectra = np.fft.fft(np.fft.fft(x * fast, axis=-1) * slow[:, None], axis=2)
    power = np.abs(spectra[:, :, 8:-8, 64:384]) ** 2 / (np.sum(fast * fast) * np.sum(slow * slow))
    real = 0.5 * power.mean(axis=(0, 2, 3))  # a channel has half of it
    ours = PRESETS["iwr6843isk"].parameters
    assert isinstance(ours, RadarParameters)
    assert ours.impairments.noise is not None
    density = ours.impairments.noise.power[0][0] / ours.chirp.sample_rate_hz
    ratio_db = 10.0 * np.log10(real / (density * p.chirp.sample_rate_hz))
    print(f"noise {real.round(1)} counts^2, over the preset's {ratio_db.round(1)} dB")
    assert np.abs(ratio_db).max() < 5.0


def test_a_simulation_fitted_to_one_half_beside_the_other() -> None:
    """Fixed pattern and noise of the first 42 loops give frames as like the next 42 as these are like the first."""
    p, codes = capture()
    codes = codes[..., :KEPT]
    chirp = p.seen.model_copy(
        update={"chirps": HALF, "samples": KEPT, "bandwidth_hz": p.chirp.bandwidth_hz * KEPT / p.chirp.samples}
    )
    found: dict[str, list[tuple[float, float]]] = {}
    for sent in codes:
        first, second = sent[:, :HALF], sent[:, HALF : 2 * HALF]
        pattern, power = first.mean(axis=1), noise_power(first[None])[0]
        dc = pattern.mean(axis=1)
        sweep = SweptPattern(
            start_frequency_hz=chirp.start_frequency_hz,
            bandwidth_hz=chirp.bandwidth_hz,
            sample_rate_hz=chirp.sample_rate_hz,
            hp_cutoff_hz=None,
            counts=tuple(tuple(row) for row in (pattern - dc[:, None]).tolist()),
        )
        impairments = Impairments(
            leakage=Leakage(dc=tuple(dc.tolist()), sweep=sweep),
            noise=ReceiverNoise(bin_hz=chirp.sample_rate_hz / KEPT, power=tuple(tuple(row) for row in power.tolist())),
        )
        chain = RadarReceiverChain(chirp, impairments, 2 * RECEIVERS, seed=1, name="radar", adc_bits=16)
        simulated = np.zeros((16, *first.shape), np.uint16)
        for seq in range(len(simulated)):
            chain.digitise(np.zeros(first.shape), seq, simulated[seq])
        real, judged = correlations(simulated, np.stack([first, second])), np.stack([second, second])
        for name, pair in correlations(simulated, judged).items():
            found.setdefault(name, []).append((pair.simulated_against_real, real[name].real_against_real))
        noise = range_doppler_noise(range_doppler(simulated)) / range_doppler_noise(range_doppler(second[None]))
        assert np.abs(20.0 * np.log10(noise)).max() < 0.5
    for name, pairs in found.items():
        simulated_real, real_real = np.mean(pairs, axis=0)
        print(f"NCC {name}: simulated against real {simulated_real:.3f}, real against real {real_real:.3f}")
        if name != "mean removed":  # what moves in the room is not simulated
            assert simulated_real == pytest.approx(real_real, abs=0.02)
