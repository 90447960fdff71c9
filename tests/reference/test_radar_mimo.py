"""Frames of several transmitters and of complex samples against the plain equation, and against one transmitter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.radar_reference import reference
from signals.samples import Vec3
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.synthesis import Synthesizer
from sim.radar.virtual_array import VirtualArray
from tests.reference.test_radar_synthesis import error, some_echoes

TX: tuple[Vec3, ...] = ((0.0, 0.0, 0.0), (0.001, 0.004, 0.002), (0.0, 0.008, 0.0), (0.0, -0.003, 0.005))
RX: tuple[Vec3, ...] = tuple((0.0005 * k, 0.002 * k, 0.0007 * k * k) for k in range(5))
FILTERS: dict[str, Any] = {"hp_cutoff_hz": 150e3, "aaf_cutoff_hz": 5e6}


def chirp_of(chirps: int, sampling: str = "complex") -> Chirp:
    return Chirp(
        center_frequency_hz=77.5e9,
        bandwidth_hz=0.8e9,
        samples=54,
        sample_rate_hz=6e6,
        chirps=chirps,
        repetition_s=58e-6,
        sampling=sampling,  # type: ignore[arg-type]
    )


ARRAYS = {
    "one, five receivers": (VirtualArray(RX), 21),
    "two in turn": (VirtualArray(RX[:4], TX[:2]), 34),
    "three in turn, an odd number each": (VirtualArray(RX[:3], TX[:3]), 27),
    "four in turn, five receivers": (VirtualArray(RX, TX), 24),
    "two bands": (VirtualArray(RX[:4], TX[:2], 2), 21),
    "three of four bands": (VirtualArray(RX[:2], TX[:3], 4), 22),
}


def frame_of(chirp: Chirp, array: VirtualArray, echoes: Echoes, **options: Any) -> NDArray[np.float64]:
    synthesizer = Synthesizer(chirp, array, **FILTERS | options)
    out = np.full(synthesizer.shape, np.nan)
    synthesizer.synthesize(echoes, out)
    return out


@pytest.mark.parametrize("sampling", ["real", "complex"])
@pytest.mark.parametrize("name", ARRAYS)
def test_direct_is_the_equation(name: str, sampling: str) -> None:
    array, chirps = ARRAYS[name]
    echoes = some_echoes(7, 150.0, 40.0)
    chirp = chirp_of(chirps, sampling)
    exact = reference(chirp, array, echoes, **FILTERS)
    assert exact.shape[0] == len(array.rx_positions_m) * (2 if sampling == "complex" else 1)
    assert error(frame_of(chirp, array, echoes, method="direct"), exact) < 2e-13


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("sampling", ["real", "complex"])
@pytest.mark.parametrize("name", ARRAYS)
def test_the_transform_is_within_its_tolerance(name: str, sampling: str, tolerance: float) -> None:
    array, chirps = ARRAYS[name]
    chirp = chirp_of(2 * chirps, sampling)
    for speed_mps in (0.0, 5.0, 60.0):
        echoes = some_echoes(800, 60.0, speed_mps, decades=3.0)
        exact = frame_of(chirp, array, echoes, method="direct")
        assert error(frame_of(chirp, array, echoes, tolerance=tolerance), exact) < tolerance


def leaving_elsewhere(echoes: Echoes) -> Echoes:
    other = some_echoes(len(echoes.range_m), 1.0, 0.0, seed=9).direction_R
    return Echoes(echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude, other)


@pytest.mark.parametrize("name", ARRAYS)
def test_echoes_that_leave_in_another_direction(name: str) -> None:
    array, chirps = ARRAYS[name]
    chirp, echoes = chirp_of(chirps), leaving_elsewhere(some_echoes(7, 150.0, 40.0))
    exact = reference(chirp, array, echoes, **FILTERS)
    assert error(frame_of(chirp, array, echoes, method="direct"), exact) < 2e-13
    many = leaving_elsewhere(some_echoes(800, 60.0, 20.0, decades=3.0))
    exact = frame_of(chirp_of(2 * chirps), array, many, method="direct")
    for tolerance in (1e-2, 1e-3, 1e-6, 1e-10):
        assert error(frame_of(chirp_of(2 * chirps), array, many, tolerance=tolerance), exact) < tolerance
    same = Echoes(many.range_m, many.speed_mps, many.direction_R, many.amplitude, many.direction_R)
    plain = Echoes(many.range_m, many.speed_mps, many.direction_R, many.amplitude)
    for method in ("direct", "nufft"):
        one, other = (frame_of(chirp_of(2 * chirps), array, e, method=method) for e in (same, plain))
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("isa", ["base", "avx2"])
def test_every_instruction_set_gives_the_same_bits(isa: str) -> None:
    array, chirps = ARRAYS["three in turn, an odd number each"]
    echoes = some_echoes(2000, 40.0, 20.0)
    for options in ({"tolerance": 1e-3}, {"tolerance": 1e-8}, {"method": "direct"}):
        try:
            other = frame_of(chirp_of(chirps), array, echoes, isa=isa, **options)
        except ValueError:
            pytest.skip(f"this CPU has no {isa}")
        assert frame_of(chirp_of(chirps), array, echoes, **options).tobytes() == other.tobytes()


def test_the_in_phase_channel_is_the_real_frame() -> None:
    array, echoes = VirtualArray(RX[:3]), some_echoes(2000, 40.0, 5.0)
    for method in ("direct", "nufft"):
        real = frame_of(chirp_of(32, "real"), array, echoes, method=method)
        both = frame_of(chirp_of(32), array, echoes, method=method)
        assert real.tobytes() == both[0::2].tobytes()


@pytest.mark.parametrize("turns", [2, 3])
def test_each_transmitter_sees_a_frame_of_its_own(turns: int) -> None:
    """Its middle is off the frame's by delta_p of its repetition time, in which the echoes go on with their speeds."""
    chirp = chirp_of(8 * turns)
    array = VirtualArray(RX[:4], TX[:turns])
    echoes = some_echoes(40, 40.0, 30.0)
    together = frame_of(chirp, array, echoes, method="direct", hp_cutoff_hz=None, aaf_cutoff_hz=None)
    of_one = chirp.model_copy(update={"chirps": 8, "repetition_s": chirp.repetition_s * turns})
    for p in range(turns):
        later_s = (p - 0.5 * (turns - 1)) * chirp.repetition_s
        moved = Echoes(
            echoes.range_m + echoes.speed_mps * later_s, echoes.speed_mps, echoes.direction_R, echoes.amplitude
        )
        places = tuple((r[0] + TX[p][0], r[1] + TX[p][1], r[2] + TX[p][2]) for r in RX[:4])
        alone = frame_of(of_one, VirtualArray(places), moved, method="direct", hp_cutoff_hz=None, aaf_cutoff_hz=None)
        assert error(together[:, p::turns], alone) < 1e-11


def test_bands_are_transmitters_displaced_in_speed() -> None:
    array, bands = VirtualArray(RX[:2], TX[:2], 4), 4
    echoes = some_echoes(50, 40.0, 10.0)
    together = frame_of(chirp_of(16), array, echoes, method="direct")
    expected = np.zeros_like(together)
    for p in range(2):
        alone = frame_of(chirp_of(16), VirtualArray(RX[:2], TX[p : p + 1]), echoes, method="direct")
        turned = (alone[0::2] + 1j * alone[1::2]) * np.exp(2j * np.pi * p * np.arange(16) / bands)[None, :, None]
        expected[0::2] += turned.real
        expected[1::2] += turned.imag
    assert error(together, expected) < 1e-12


@pytest.mark.parametrize(
    ("array", "chirps", "words"),
    [
        (VirtualArray(RX, TX[:3]), 32, "32 chirps are not two or more for each of 3"),
        (VirtualArray(RX, TX[:3]), 3, "3 chirps are not"),
        (VirtualArray(RX, TX[:3], 2), 32, "doppler_bands"),
        (VirtualArray(RX, TX * 4), 32, "1 to 12 places"),
        (VirtualArray(RX, ((0.0, float("nan"), 0.0),)), 32, "tx_positions_m"),
    ],
)
def test_arrays_refused(array: VirtualArray, chirps: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Synthesizer(chirp_of(chirps), array, **FILTERS)
