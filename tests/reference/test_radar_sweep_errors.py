"""Phase noise with range correlation, sweep errors, compression and antenna cuts: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.radar.adc import RadarReceiverChain
from sim.radar.antenna import Pattern
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.coupling import Coupling, couple
from sim.radar.echoes import Echoes
from sim.radar.impairments import Compression, Impairments
from sim.radar.receiver import Receiver
from sim.radar.sweep_errors import Sweep, SweepErrors
from sim.radar.synthesis import Synthesizer
from sim.radar.virtual_array import VirtualArray
from tests.worlds.radar_point_targets import CHIRP, direction

COMPLEX = CHIRP.model_copy(update={"sampling": "complex", "samples": 128, "sample_rate_hz": 4e6})
ARRAY = VirtualArray(((0.0, 0.0, 0.0), (0.0, 0.0025, 0.0)))
RECEIVER = Receiver(tx_power_dbm=5.0, conversion_gain_db=60.0, impedance_ohm=50.0, adc_full_scale_v=1.2, adc_bits=12)
LEVELS = ((30e3, -70.0), (100e3, -80.0), (1e6, -95.0), (1e7, -115.0))


def echo(range_m: float) -> Echoes:
    return Echoes(np.array([range_m]), np.zeros(1), np.array([[1.0, 0.0, 0.0]]), np.array([100.0]))


def frames(range_m: float, sweep: Sweep, seq: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the complex samples of the first receiver without and with the errors."""
    x = np.zeros((4, COMPLEX.chirps, COMPLEX.samples))
    Synthesizer(COMPLEX, ARRAY, hp_cutoff_hz=None, aaf_cutoff_hz=None, method="direct").synthesize(echo(range_m), x)
    y = x.copy()
    SweepErrors(COMPLEX, ARRAY, RECEIVER, sweep, seed=1, name="radar").add(echo(range_m), y, seq)
    return x[0] + 1j * x[1], y[0] + 1j * y[1]


@pytest.mark.parametrize("range_m", [3.0, 9.0])
def test_phase_noise_has_the_power_of_range_correlation(range_m: float) -> None:
    """4 L(f) sin^2(pi f tau) on either side of the carrier, within 0.5 dB at offsets to 0.08 / tau."""
    sweep, n = Sweep(phase_noise=LEVELS), COMPLEX.samples
    power, count = np.zeros(n), 40
    for seq in range(count):
        x, y = frames(range_m, sweep, seq)
        power += np.mean(np.abs(np.fft.fft(y / x - 1.0, axis=1) / n) ** 2, axis=0) / count  # of the carrier, a bin
    step_hz, tau = COMPLEX.sample_rate_hz / n, 2.0 * range_m / SPEED_OF_LIGHT_MPS
    for b in range(2, n // 2 - 1, 3):
        f = b * step_hz
        if f > 0.08 / tau:
            break
        expected = 4.0 * sweep.noise_at(f) * math.sin(math.pi * f * tau) ** 2 * step_hz
        for side in (b, n - b):
            assert abs(10.0 * math.log10(power[side] / expected)) < 0.5


def test_a_sweep_error_gives_paired_echoes() -> None:
    """D cos(2 pi k t / T): echoes k bins on either side with pi tau D of the amplitude."""
    k, deviation_hz, range_m = 5, 40e3, 8.0
    rows = tuple(((i + 0.5) / 512, deviation_hz * math.cos(2.0 * math.pi * k * ((i + 0.5) / 512))) for i in range(512))
    x, y = frames(range_m, Sweep(nonlinearity=rows))
    lines = np.abs(np.fft.fft((y / x)[0]) / COMPLEX.samples)
    expected = math.pi * 2.0 * range_m / SPEED_OF_LIGHT_MPS * deviation_hz
    for b in (k, COMPLEX.samples - k):
        assert abs(20.0 * math.log10(lines[b] / expected)) < 0.1
    assert lines[0] == pytest.approx(1.0, abs=1e-3)


def test_real_samples_are_the_in_phase_ones() -> None:
    sweep = Sweep(phase_noise=LEVELS, nonlinearity=((0.0, 1e4), (1.0, -1e4)))
    both, real = np.zeros((4, 64, 128)), np.zeros((2, 64, 128))
    SweepErrors(COMPLEX, ARRAY, RECEIVER, sweep, seed=3, name="r").add(echo(5.0), both, 7)
    one = COMPLEX.model_copy(update={"sampling": "real"})
    SweepErrors(one, ARRAY, RECEIVER, sweep, seed=3, name="r").add(echo(5.0), real, 7)
    assert both[0::2].tobytes() == real.tobytes()


def test_sweeps_refused() -> None:
    with pytest.raises(ValueError, match="phase_noise must have rising"):
        Sweep(phase_noise=((1e6, -90.0), (1e5, -80.0)))
    with pytest.raises(ValueError, match="a line needs 2"):
        Sweep(nonlinearity=((0.5, 1.0),))
    wide = Impairments(sweep=Sweep(nonlinearity=((0.0, -5e6), (1.0, 5e6))))
    assert "the limit is 0.3" in wide.problems_with(CHIRP, 3)[0]


def test_compression_has_the_harmonic_of_its_curve() -> None:
    """A^3 / (8 L^2) at the third harmonic, and 1 dB of compression at 0.59 of the limit."""
    limit = 10_000.0
    n = np.arange(CHIRP.samples)

    def lines(amplitude: float) -> np.ndarray:
        chain = RadarReceiverChain(
            CHIRP, Impairments(compression=Compression(limit_counts=limit)), 1, seed=1, name="r", adc_bits=16
        )
        signal = np.tile(amplitude * np.cos(2.0 * np.pi * 4 * n / 64), (1, CHIRP.chirps, 1))
        codes = np.empty(signal.shape, np.uint16)
        chain.digitise(signal, 0, codes)
        return np.abs(np.fft.rfft(codes[0].mean(axis=0))) * 2.0 / 64

    weak = lines(2000.0)
    assert abs(20.0 * math.log10(weak[12] / (2000.0**3 / (8.0 * limit**2)))) < 0.5
    assert weak[4] == pytest.approx(2000.0 * (1.0 - 3.0 * 0.04 / 8.0), rel=0.002)
    ratio = {share: 20.0 * math.log10(lines(share * limit)[4] / (share * limit)) for share in (0.57, 0.61)}
    assert ratio[0.57] > -1.0 > ratio[0.61]


CUT = (
    (-180.0, -40.0),
    (-60.0, -25.0),
    (-40.0, -13.0),
    (-25.0, -20.0),
    (0.0, 0.0),
    (25.0, -20.0),
    (40.0, -13.0),
    (180.0, -40.0),
)


def test_cuts_have_their_rows() -> None:
    plain = Pattern(gain_dbi=10.0, azimuth_beamwidth_deg=50.0, elevation_beamwidth_deg=30.0)
    cut = plain.model_copy(update={"azimuth_cut": CUT})
    both = plain.model_copy(update={"azimuth_cut": CUT, "elevation_cut": ((-90.0, -30.0), (0.0, 0.0), (90.0, -30.0))})
    for angle, level in (*CUT, (-50.0, -19.0), (10.0, -8.0)):
        d = np.array([direction(angle, 0.0)])
        assert 10.0 * math.log10(cut.share(d)[0] if abs(angle) < 90.0 else both.share(d)[0]) == pytest.approx(
            level, abs=0.02
        )
    tilted = np.array([direction(10.0, 30.0)])
    assert 10.0 * math.log10(both.share(tilted)[0]) == pytest.approx(-18.0, abs=0.02)
    ahead = np.array([direction(0.0, 15.0)])
    assert cut.share(ahead)[0] == pytest.approx(0.5, rel=1e-6)
    with pytest.raises(ValueError, match="rising angles"):
        Pattern(
            gain_dbi=1.0, azimuth_beamwidth_deg=50.0, elevation_beamwidth_deg=30.0, azimuth_cut=((1.0, 0.0), (0.0, 0.0))
        )


def test_coupled_receivers_have_shares_of_each_other() -> None:
    rng = np.random.Generator(np.random.Philox(1))
    z = rng.normal(size=(2, 4, 8)) + 1j * rng.normal(size=(2, 4, 8))
    signal = np.stack([z[0].real, z[0].imag, z[1].real, z[1].imag])
    couple(Coupling(rows=((1, 2, -20.0, 30.0), (2, 1, -26.0, -90.0))), 2, signal)
    expected = (z[0] + 0.1 * np.exp(1j * math.pi / 6.0) * z[1], z[1] - 1j * 10.0**-1.3 * z[0])
    for k in range(2):
        assert np.allclose(signal[2 * k] + 1j * signal[2 * k + 1], expected[k], atol=1e-12)
    real = rng.normal(size=(2, 4, 8))
    turned = real.copy()
    couple(Coupling(rows=((2, 1, -20.0, 180.0),)), 1, turned)
    assert np.allclose(turned, np.stack([real[0], real[1] - 0.1 * real[0]]), atol=1e-12)


def test_couplings_refused() -> None:
    with pytest.raises(ValueError, match="two rows"):
        Coupling(rows=((1, 2, -20.0, 0.0), (1, 2, -21.0, 0.0)))
    with pytest.raises(ValueError, match="coupled to itself"):
        Coupling(rows=((1, 1, -20.0, 0.0),))
    for rows, words in ((((1, 4, -20.0, 0.0),), "names receiver 4"), (((1, 2, -20.0, 45.0),), "real samples cannot")):
        assert words in Impairments(coupling=Coupling(rows=rows)).problems_with(CHIRP, 3)[0]
