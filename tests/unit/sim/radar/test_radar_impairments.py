"""Each impairment does what its model says, can be switched alone, and draws from streams of its own."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sim.radar.adc import RadarReceiverChain
from sim.radar.chirp import Chirp
from sim.radar.impairments import Adc, DcWander, Impairments, Leakage, ReceiverNoise
from tests.worlds.radar_recordings import DECAY_S, NARROW, WIDE, digitise, frames_of, sweep, truth

PARTS = ("leakage", "frame_start", "dc_wander", "noise", "adc")


def only(*parts: str) -> Impairments:
    return Impairments(**{part: getattr(truth(), part) for part in parts})


def without(part: str) -> Impairments:
    return truth().model_copy(update={part: None})


def signed(codes: np.ndarray) -> np.ndarray:
    return codes.astype(np.int32)


def test_with_all_off_the_converter_rounds_about_the_middle_of_its_scale() -> None:
    signal = np.linspace(-300.0, 300.0, 2 * 64 * 64).reshape(2, 64, 64)
    assert np.array_equal(signed(digitise(Impairments(), signal=signal)), np.floor(signal + 2048.5))


@pytest.mark.parametrize("part", PARTS)
def test_each_part_is_in_the_samples_and_switching_it_changes_no_other(part: str) -> None:
    assert not np.array_equal(digitise(truth()), digitise(without(part)))
    if part == "adc":
        assert np.abs(signed(digitise(truth())) - signed(digitise(without(part)))).max() <= 1
        return
    # What is missing without it is what it gives by itself, within the rounding of three codes.
    whole, rest = (signed(digitise(i.model_copy(update={"adc": None}))) for i in (truth(), without(part)))
    middle = 2048  # a converter's, where there is no leakage
    alone = signed(digitise(only(part))) - middle
    missing = whole - rest + (middle if part == "leakage" else 0)
    if part == "leakage":
        alone += middle
    assert np.abs(missing - alone).max() <= 2


def noise_of(codes: np.ndarray) -> np.ndarray:
    """Return the noise of receiver 1 per chirp and sample, without the constant part."""
    x = codes[0].astype(float)
    return (x - x.mean(axis=0)).ravel()


def test_leakage_is_exact_for_the_recorded_chirp() -> None:
    leakage = truth().leakage
    assert leakage is not None
    frame = signed(digitise(only("leakage")))
    expected = np.array(leakage.dc)[:, None] + np.array(leakage.sweep.counts)
    assert np.array_equal(frame, np.broadcast_to(np.floor(expected + 0.5)[:, None, :], frame.shape))


def test_the_frame_start_decays() -> None:
    start = truth().frame_start
    assert start is not None
    big = start.model_copy(update={"sweep": sweep([[1000.0] * 64, [500.0] * 64])})
    frame = signed(digitise(Impairments(frame_start=big))) - 2048
    expected = np.exp(-np.arange(64) * WIDE.repetition_s / DECAY_S)
    assert np.abs(frame - np.array([1000.0, 500.0])[:, None, None] * expected[:, None]).max() <= 0.5 + 1e-9


def test_the_dc_wanders_from_chirp_to_chirp_and_within_none() -> None:
    loud = Impairments(dc_wander=DcWander(sigma=(30.0, 60.0)))
    frames = signed(frames_of(loud, 20)) - 2048
    assert np.ptp(frames, axis=3).max() == 0
    steps = frames[..., 0].transpose(1, 0, 2).reshape(2, -1)
    assert steps.std(axis=1) == pytest.approx([30.0, 60.0], rel=4.0 / math.sqrt(2 * steps.shape[1]))
    assert abs(np.corrcoef(steps)[0, 1]) < 4.0 / math.sqrt(steps.shape[1])
    assert abs(np.corrcoef(steps[0, 1:], steps[0, :-1])[0, 1]) < 4.0 / math.sqrt(steps.shape[1])


def test_the_noise_has_the_power_stated_in_every_bin_and_is_independent_between_receivers() -> None:
    power = (tuple(400.0 * (2.0 - b / 32.0) for b in range(33)), tuple(100.0 + 10.0 * b for b in range(33)))
    frames = signed(frames_of(Impairments(noise=ReceiverNoise(bin_hz=31250.0, power=power)), 40)) - 2048
    spectra = np.fft.rfft(frames, axis=-1)
    measured = (np.abs(spectra) ** 2).mean(axis=(0, 2)) / 64 - 1.0 / 12.0
    count = 40 * 64
    assert np.abs(measured / np.array(power) - 1.0)[:, 1:-1].max() < 4.5 / math.sqrt(count)
    assert np.abs(measured / np.array(power) - 1.0)[:, [0, -1]].max() < 4.5 * math.sqrt(2.0 / count)
    flat = frames.transpose(1, 0, 2, 3).reshape(2, -1)
    assert abs(np.corrcoef(flat)[0, 1]) < 0.02
    chirps = frames[:, 0].reshape(-1, 64)
    assert abs((chirps[1:] * chirps[:-1]).mean() / chirps.var()) < 0.02


def test_the_envelope_says_how_loud_the_noise_is_over_the_chirp() -> None:
    white = ReceiverNoise(bin_hz=31250.0, power=((900.0, 900.0),), envelope=((1.4, 0.2),))
    frames = signed(frames_of(Impairments(noise=white), 20, receivers=1))
    sigma = frames.std(axis=(0, 1, 2)) / 30.0
    expected = [white.envelope_at(0, (n + 0.5) / 64) for n in range(64)]
    assert expected[0] == 1.4
    assert expected[-1] == pytest.approx(0.2)
    assert np.abs(sigma / expected - 1.0).max() < 4.5 / math.sqrt(2 * 20 * 64)


def test_the_power_of_a_bin_is_interpolated_and_held_at_the_end() -> None:
    noise = ReceiverNoise(bin_hz=100.0, power=((1.0, 3.0, 7.0),))
    assert [noise.power_at(0, f) for f in (0.0, 50.0, 100.0, 150.0, 200.0, 1e6)] == [1.0, 2.0, 3.0, 5.0, 7.0, 7.0]


@pytest.mark.parametrize("share", [0.0, 0.05, 0.13, 0.3, 0.5])
def test_codes_are_as_wide_as_their_share_says(share: float) -> None:
    ramp = np.linspace(-100.0, 100.0, 2 * 64 * 64, endpoint=False).reshape(2, 64, 64)
    codes = digitise(Impairments(adc=Adc(odd_code_share=share)), signal=ramp)
    assert (codes & 1).mean() == pytest.approx(share, abs=2e-3)
    error = codes - 2048.0 - ramp
    assert error.mean() == pytest.approx(0.0, abs=0.01)  # each code is in the middle of what it stands for
    assert error.var() == pytest.approx(Adc(odd_code_share=share).noise_power, rel=0.01)


def test_any_finite_signal_clips_and_one_that_is_not_is_named() -> None:
    signal = np.zeros((2, 64, 64))
    signal[0, 0, :4] = [1e300, -1e300, 1.7976931348623157e308, -1e4]
    assert digitise(truth(), signal=signal)[0, 0, :4].tolist() == [4095, 0, 4095, 0]
    for value in (math.nan, math.inf, -math.inf):
        signal[1, 17, 63] = value
        with pytest.raises(ValueError, match="sample 63 of chirp 17 of receiver 2"):
            digitise(truth(), signal=signal)


def test_same_seed_same_bytes_and_any_frame_without_those_before() -> None:
    frames = frames_of(truth(), 4)
    assert np.array_equal(frames[3], digitise(truth(), seq=3))
    noisy = only("noise")
    first = noise_of(digitise(noisy, seq=3))
    for change in ({"seq": 2}, {"seed": 2}, {"name": "other"}):
        other = noise_of(digitise(noisy, **({"seq": 3} | change)))
        assert abs(np.corrcoef(first, other)[0, 1]) < 4.5 / 64.0


def test_another_receiver_changes_no_draw() -> None:
    assert np.array_equal(digitise(truth(3), receivers=3)[:2, :, :], digitise(truth(2)))


@pytest.mark.parametrize("isa", ["base", "avx2", "avx512"])
def test_the_same_bits_with_every_instruction_set_and_on_every_machine(isa: str) -> None:
    odd = Chirp(
        center_frequency_hz=60.8e9,
        bandwidth_hz=1e9,
        samples=74,  # no multiple of a register
        sample_rate_hz=2e6,
        chirps=5,
        repetition_s=400e-6,
    )
    digest = hashlib.blake2b(digest_size=8)
    try:
        for chirp in (WIDE, NARROW, odd):
            shape = (2, chirp.chirps, chirp.samples)
            signal = (np.arange(np.prod(shape)) % 97 * 1.25).reshape(shape)
            digest.update(digitise(truth(), chirp=chirp, signal=signal, seq=5, isa=isa).tobytes())
    except ValueError as error:
        pytest.skip(str(error))
    assert digest.hexdigest() == "6cd7817a2b8120df"


def test_a_narrower_sweep_leaks_as_the_high_pass_lets_it() -> None:
    """Against the high-pass's answer to a tone: leakage u = A cos(2 pi tau f) is a beat frequency S tau."""
    tau_s, amplitude, cutoff_hz = 0.35e-9, 300.0, 80e3
    wide = sweep([pass_through(WIDE, tau_s, amplitude, cutoff_hz)], hp_cutoff_hz=cutoff_hz)
    for chirp in (NARROW, WIDE.model_copy(update={"samples": 128}), WIDE.model_copy(update={"sample_rate_hz": 1e6})):
        found = np.array(wide.at(chirp)[0])
        # The turn-on is the recorded one; what is told is how the rest answers the slower or faster sweep.
        expected = np.array(pass_through(chirp, tau_s, amplitude, cutoff_hz))
        assert np.abs(found - expected).max() < 0.01 * amplitude
    assert np.ptp(np.array(wide.at(NARROW)[0])[30:]) < 0.05 * np.ptp(np.array(wide.counts[0])[30:])


def pass_through(
    chirp: Chirp, tau_s: float, amplitude: float, cutoff_hz: float, *, turn_on: float = 50.0
) -> list[float]:
    """First-order high-pass in steps of a fiftieth of a sample, from a state that gives `turn_on` at the start."""
    steps = 50
    dt = 1.0 / chirp.sample_rate_hz / steps
    t = np.arange(chirp.samples * steps) * dt
    u = amplitude * np.cos(2.0 * np.pi * tau_s * (chirp.start_frequency_hz + chirp.slope_hz_per_s * t))
    decay = math.exp(-2.0 * math.pi * cutoff_hz * dt)
    y = [turn_on]
    for i in range(1, len(u)):
        y.append(decay * y[-1] + math.sqrt(decay) * (u[i] - u[i - 1]))
    return y[::steps]


def test_without_a_high_pass_the_pattern_is_read_at_the_frequency() -> None:
    plain = sweep([[math.sin(0.2 * n) * 100.0 for n in range(64)]], hp_cutoff_hz=None)
    found = plain.at(NARROW)[0]
    place = (60.6e9 + np.arange(64) * 0.4e9 / 64 - 58e9) / (5.5e9 / 64)
    assert np.abs(np.array(found) - 100.0 * np.sin(0.2 * place)).max() < 0.05


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"receivers": 3}, "has 2 receivers, but the antenna has 3"),
        ({"chirp": WIDE.model_copy(update={"center_frequency_hz": 62e9})}, "does not cover a sweep from 59.25"),
    ],
)
def test_parts_that_do_not_fit_are_refused_with_words(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        digitise(truth(), **change)


@pytest.mark.parametrize(
    "values",
    [
        {"adc": {"odd_code_share": 0.6}},
        {"dc_wander": {"sigma": (-1.0,)}},
        {"dc_wander": {"sigma": (math.nan,)}},
        {"noise": {"bin_hz": 0.0, "power": ((1.0, 1.0),)}},
        {"noise": {"bin_hz": 1.0, "power": ((1.0, 1.0),), "envelope": ((1.0,), (1.0,))}},
        {"unknown": None},
    ],
)
def test_models_refuse_what_cannot_be(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Impairments.model_validate(values)


def test_leakage_refuses_rows_that_differ() -> None:
    with pytest.raises(ValidationError, match="dc has 1 receivers"):
        Leakage(dc=(1.0,), sweep=sweep([[0.0] * 64] * 2))
    with pytest.raises(ValidationError, match="the same length for every receiver"):
        sweep([[0.0] * 64, [0.0] * 32])


def test_arrays_of_another_shape_are_refused() -> None:
    chain = RadarReceiverChain(WIDE, truth(), 2, seed=1, name="radar")
    with pytest.raises(ValueError, match="signal must be"):
        chain.digitise(np.zeros((2, 64, 32)), 0, np.zeros((2, 64, 64), np.uint16))
    with pytest.raises(ValueError, match="output must be"):
        chain.digitise(np.zeros((2, 64, 64)), 0, np.zeros((1, 64, 64), np.uint16))
    with pytest.raises(TypeError):
        chain.digitise(np.zeros((2, 64, 64)), 0, np.zeros((2, 64, 64), np.int16))
