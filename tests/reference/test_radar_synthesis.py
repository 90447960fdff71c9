"""Frames of echoes against the plain equation, the methods against each other, and numerically hard echoes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.radar_reference import reference
from signals.samples import Vec3
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.echoes import Echoes
from sim.radar.synthesis import Synthesizer
from tests.worlds.radar_point_targets import CHIRP as TABLE_2
from tests.worlds.radar_recordings import WIDE

ODD = Chirp(
    center_frequency_hz=24.1e9,
    bandwidth_hz=0.3e9,
    samples=50,
    sample_rate_hz=1.1e6,
    chirps=27,
    repetition_s=1e-4,
)
CHIRPS = {"table 2": TABLE_2, "recorded": WIDE, "odd": ODD}
RX: tuple[Vec3, ...] = ((0.0, 0.0025, 0.0), (0.0, 0.0, 0.0025), (0.0, 0.0, 0.0))


def some_echoes(n: int, range_m: float, speed_mps: float, *, decades: float = 0.3, seed: int = 1) -> Echoes:
    """Return random echoes up to a range and a speed, with amplitudes over `decades` decades."""
    g = np.random.default_rng(seed)
    direction = g.normal(size=(n, 3))
    direction /= np.sqrt((direction**2).sum(1))[:, None]
    return Echoes(
        g.uniform(0.0, range_m, n), g.uniform(-speed_mps, speed_mps, n), direction, 10.0 ** -g.uniform(0.0, decades, n)
    )


def alike(n: int, range_m: float | NDArray[np.float64], speed_mps: float = 0.0) -> Echoes:
    """Return n echoes from ahead with the same amplitude, enough for the grid method to be used."""
    direction = np.zeros((n, 3))
    direction[:, 0] = 1.0
    return Echoes(np.full(n, range_m), np.full(n, speed_mps), direction, np.ones(n))


def ordered(echoes: Echoes, order: NDArray[np.int64]) -> Echoes:
    e = echoes
    return Echoes(e.range_m[order], e.speed_mps[order], e.direction_R[order], e.amplitude[order])


def make(chirp: Chirp, **options: Any) -> Synthesizer:
    return Synthesizer(chirp, RX, **{"hp_cutoff_hz": 80e3, "aaf_cutoff_hz": 600e3} | options)


def frame_of(chirp: Chirp, echoes: Echoes, **options: Any) -> NDArray[np.float64]:
    synthesizer = make(chirp, **options)
    out = np.full(synthesizer.shape, np.nan)
    synthesizer.synthesize(echoes, out)
    return out


def norm(x: NDArray[Any]) -> float:
    return float(np.sqrt((x.astype(np.float64) ** 2).sum()))


def error(x: NDArray[Any], exact: NDArray[Any]) -> float:
    return norm(x - exact) / norm(exact)


@pytest.mark.parametrize("name", CHIRPS)
@pytest.mark.parametrize("filters", [{}, {"hp_cutoff_hz": None, "aaf_cutoff_hz": None}], ids=["filtered", "plain"])
def test_direct_is_the_equation_at_200_m(name: str, filters: dict[str, None]) -> None:
    echoes = some_echoes(7, 200.0, 30.0)
    cutoffs: dict[str, Any] = {"hp_cutoff_hz": 80e3, "aaf_cutoff_hz": 600e3} | filters
    exact = reference(CHIRPS[name], RX, echoes, **cutoffs)
    assert error(frame_of(CHIRPS[name], echoes, method="direct", **cutoffs), exact) < 1e-13


@pytest.mark.parametrize("name", CHIRPS)
@pytest.mark.parametrize(
    ("range_m", "speed_mps"), [pytest.param(12.0, 0.0, marks=pytest.mark.slow), (12.0, 3.0), (200.0, 30.0)]
)
def test_error_stays_below_the_tolerance(name: str, range_m: float, speed_mps: float) -> None:
    chirp = CHIRPS[name]
    for n in (300, 8000):
        echoes = some_echoes(n, range_m, speed_mps)
        exact = frame_of(chirp, echoes, method="direct")
        for tolerance in (1e-1, 1e-2, 1e-3, 1e-6, 1e-9, 1e-12):
            synthesizer = make(chirp, tolerance=tolerance)
            out = np.empty(synthesizer.shape)
            report = synthesizer.synthesize(echoes, out)
            found = error(out, exact)
            assert found <= tolerance
            assert found <= report.error_bound + 1e-14
            if n == 8000 and name != "recorded":
                assert report.width > 0
                assert found > 1e-3 * tolerance  # no more exact than it needs to be


@pytest.mark.parametrize("scale", [1e-90, 1e-45, 1e-38, 1e38, 1e90])
def test_amplitudes_beyond_single_precision(scale: float) -> None:
    """Grids in single precision: cells and factors must stay within a float, whatever the echoes' unit."""
    echoes = some_echoes(2000, 12.0, 10.0)
    exact = frame_of(TABLE_2, echoes, method="direct")
    synthesizer = make(TABLE_2, tolerance=1e-3)
    out = np.empty(synthesizer.shape)
    scaled = Echoes(echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude * scale)
    report = synthesizer.synthesize(scaled, out)
    assert report.terms > report.panels  # of two terms and more: those are in single precision
    assert report.rounds == 1
    assert error(out / scale, exact) <= 1e-3


@pytest.mark.parametrize(
    "place", [0.0, 0.25, 1e-12, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.5, 1.0 - 1e-12))]
)
def test_one_echo_anywhere_between_the_points_of_the_grid(place: float) -> None:
    per_sample = 2.0 * TABLE_2.bandwidth_hz / TABLE_2.samples / SPEED_OF_LIGHT_MPS  # cycles per metre
    per_chirp = 2.0 * TABLE_2.repetition_s * (TABLE_2.start_frequency_hz + 0.2e9) / SPEED_OF_LIGHT_MPS
    for range_cell, speed_cell in ((21, 0), (64, 9), (127, 64), (128, -64), (1029, -2000)):
        range_m = (range_cell + place) / 128.0 / per_sample
        speed_mps = (speed_cell + place) / 128.0 / per_chirp
        echoes = alike(200, range_m, speed_mps)
        exact = frame_of(TABLE_2, echoes, method="direct")
        for tolerance in (1e-2, 1e-3, 1e-6, 1e-9):
            assert error(frame_of(TABLE_2, echoes, tolerance=tolerance), exact) <= tolerance


@pytest.mark.parametrize("speed_mps", [0.0, 2.0])
def test_echoes_that_cancel_stay_within_tolerance(speed_mps: float) -> None:
    """Pairs a quarter of a wavelength apart nearly cancel: the lost digits must be recovered."""
    middle_hz = TABLE_2.center_frequency_hz - TABLE_2.bandwidth_hz / (2 * TABLE_2.samples)
    shift_m = SPEED_OF_LIGHT_MPS / middle_hz / 4.0
    range_m = np.repeat(np.linspace(1.0, 11.0, 400), 2)
    range_m[1::2] += shift_m
    echoes = alike(800, range_m, speed_mps)
    exact = frame_of(TABLE_2, echoes, method="direct")
    assert norm(exact) < 0.05 * np.sqrt(0.5 * 800 * exact.size)
    for tolerance in (1e-2, 1e-3, 1e-6, 1e-9):
        synthesizer = make(TABLE_2, tolerance=tolerance)
        out = np.empty(synthesizer.shape)
        report = synthesizer.synthesize(echoes, out)
        assert error(out, exact) <= tolerance
        assert report.rounds > 1


@pytest.mark.parametrize("name", ["table 2", "recorded"])
@pytest.mark.parametrize(("shift", "speed_mps"), [(1.0, 3.2e-3), (1.0, 1.5e-6), (1.05, 1.4e-2), (1.0 + 1e-6, 0.0)])
def test_hundreds_in_phase_against_hundreds_in_antiphase(name: str, shift: float, speed_mps: float) -> None:
    chirp = CHIRPS[name]
    middle_hz = chirp.center_frequency_hz - chirp.bandwidth_hz / (2 * chirp.samples)
    echoes = alike(600, np.repeat([19.2, 19.2 + shift * SPEED_OF_LIGHT_MPS / middle_hz / 4.0], 300), 1.4)
    echoes.speed_mps[300:] += speed_mps
    exact = frame_of(chirp, echoes, method="direct")
    for tolerance in (1e-1, 1e-3, 1e-5, 1e-7, 1e-9):
        assert error(frame_of(chirp, echoes, tolerance=tolerance), exact) <= tolerance


@pytest.mark.parametrize("range_m", [0.0, 1e-4, 6e-4, 6.17e-4, 5e-3])
def test_a_nearly_constant_phase_stays_within_tolerance(range_m: float) -> None:
    """Only the real part cancels if all samples are near a zero of the cosine."""
    echoes = alike(300, range_m)
    plain: dict[str, Any] = {"hp_cutoff_hz": None, "aaf_cutoff_hz": None}
    exact = frame_of(TABLE_2, echoes, method="direct", **plain)
    for tolerance in (1e-1, 1e-3, 1e-6, 1e-9):
        assert error(frame_of(TABLE_2, echoes, tolerance=tolerance, **plain), exact) <= tolerance


def test_the_weakest_are_left_out_within_their_bound() -> None:
    echoes = some_echoes(6000, 12.0, 1.0, decades=14.0)
    exact = frame_of(TABLE_2, echoes, method="direct")
    for tolerance in (1e-2, 1e-6):
        synthesizer, complete = make(TABLE_2, tolerance=tolerance), make(TABLE_2, tolerance=tolerance, drop_share=0.0)
        out = np.empty(synthesizer.shape)
        report = synthesizer.synthesize(echoes, out)
        assert 600 < report.dropped < 6000
        assert 0.0 < report.dropped_bound <= 0.5 * tolerance
        assert error(out, exact) <= tolerance
        assert complete.synthesize(echoes, out).dropped == 0
        assert error(out, exact) <= tolerance


def test_none_is_left_out_where_the_strong_ones_cancel() -> None:
    """The strong pair alone would allow it; its remainder after cancellation does not."""
    middle_hz = TABLE_2.center_frequency_hz - TABLE_2.bandwidth_hz / (2 * TABLE_2.samples)
    pair = np.array([3.0, 3.0 + SPEED_OF_LIGHT_MPS / middle_hz / 4.0])
    echoes = alike(1002, np.concatenate([pair, np.linspace(2.0, 11.0, 1000)]))
    echoes.amplitude[2:] = 1e-8
    synthesizer = make(TABLE_2, tolerance=1e-4)
    out = np.empty(synthesizer.shape)
    echoes.amplitude[0] = 0.0
    assert synthesizer.synthesize(echoes, out).dropped == 1000
    echoes.amplitude[0] = 1.0
    report = synthesizer.synthesize(echoes, out)
    assert error(out, frame_of(TABLE_2, echoes, method="direct")) <= 1e-4
    assert report.dropped == 0 or report.dropped_bound <= 1e-4


@pytest.mark.parametrize("method", ["direct", "nufft"])
def test_without_echoes_there_is_no_signal(method: str) -> None:
    for echoes in (some_echoes(0, 1.0, 0.0), Echoes(np.ones(4), np.ones(4), np.zeros((4, 3)), np.zeros(4))):
        assert np.array_equal(frame_of(TABLE_2, echoes, method=method), np.zeros((3, 64, 64)))


def test_echoes_of_no_amplitude_change_no_bit() -> None:
    echoes = some_echoes(3000, 12.0, 3.0)
    plain = frame_of(TABLE_2, echoes)
    padded = Echoes(
        np.concatenate([[5e4], echoes.range_m]),
        np.concatenate([[900.0], echoes.speed_mps]),
        np.concatenate([[[0.0, 1.0, 0.0]], echoes.direction_R]),
        np.concatenate([[0.0], echoes.amplitude]),
    )
    out = np.empty((3, 64, 64))
    assert make(TABLE_2).synthesize(padded, out).echoes == 3000
    assert np.array_equal(out, plain)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_a_frame_does_not_depend_on_the_one_before(tolerance: float) -> None:
    used = make(TABLE_2, tolerance=tolerance)
    out = np.empty(used.shape)
    few = some_echoes(1000, 2.0, 0.1)  # in some rows and columns of the grids only
    for echoes in (some_echoes(9000, 12.0, 20.0), few, some_echoes(40, 5.0, 1.0), some_echoes(3000, 12.0, 1.0), few):
        used.synthesize(echoes, out)
        assert np.array_equal(out, frame_of(TABLE_2, echoes, tolerance=tolerance))


@pytest.mark.parametrize("name", CHIRPS)
@pytest.mark.parametrize("count", [4033, 4096, 4111])
def test_neighbours_in_one_cell(name: str, count: int) -> None:
    """Echoes that follow each other in one cell of the grid are added together: none is lost, none counts twice."""
    chirp, echoes = CHIRPS[name], some_echoes(count, 12.0, 2.0)
    order = np.lexsort((echoes.range_m, np.rint(echoes.speed_mps * 4.0)))
    echoes = ordered(echoes, order)
    exact = frame_of(chirp, echoes, method="direct")
    mixed = np.random.default_rng(1).permutation(count)
    for tolerance in (1e-2, 1e-3, 2e-4):
        out = frame_of(chirp, echoes, tolerance=tolerance)
        assert error(out, exact) <= tolerance
        assert error(frame_of(chirp, ordered(echoes, mixed), tolerance=tolerance), out) < 1e-6


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_more_receivers_than_are_summed_at_once(tolerance: float) -> None:
    positions: tuple[Vec3, ...] = tuple((0.0, 0.002 * k, -0.001 * k) for k in range(6))
    echoes = some_echoes(2000, 12.0, 1.0)
    for method in ("direct", "nufft"):
        six = Synthesizer(TABLE_2, positions, hp_cutoff_hz=None, aaf_cutoff_hz=None, method=method, tolerance=tolerance)
        together = np.empty(six.shape)
        six.synthesize(echoes, together)
        for k in range(6):
            one = Synthesizer(
                TABLE_2,
                positions[k : k + 1],
                hp_cutoff_hz=None,
                aaf_cutoff_hz=None,
                method="direct",
                tolerance=tolerance,
            )
            alone = np.empty(one.shape)
            one.synthesize(echoes, alone)
            assert error(together[k : k + 1], alone) <= (tolerance if method == "nufft" else 1e-14)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "fft"}, "no synthesis method 'fft'; methods: direct, nufft"),
        ({"tolerance": 1e-13}, "tolerance must lie in"),
        ({"tolerance": 0.5}, "tolerance must lie in"),
        ({"tolerance": float("nan")}, "tolerance must lie in"),
        ({"drop_share": 1.0}, "drop_share"),
        ({"hp_cutoff_hz": 0.0}, "hp_cutoff_hz"),
        ({"aaf_cutoff_hz": float("nan")}, "aaf_cutoff_hz"),
        ({"isa": "sse9"}, "unknown instruction set"),
    ],
)
def test_options_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make(TABLE_2, **options)


@pytest.mark.parametrize("positions", [(), ((0.0, 0.0),), ((0.0, float("nan"), 0.0),), ((0.0, 0.0, 0.0),) * 17])
def test_receivers_refused(positions: Any) -> None:
    with pytest.raises(ValueError, match=r"receivers|rx_positions_m"):
        Synthesizer(TABLE_2, positions, hp_cutoff_hz=None, aaf_cutoff_hz=None)


@pytest.mark.parametrize("method", ["direct", "nufft"])
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("range_m", np.nan),
        ("range_m", np.inf),
        ("range_m", -0.1),
        ("speed_mps", np.nan),
        ("speed_mps", -2000.0),
        ("direction_R", np.nan),
        ("direction_R", 1.5),
        ("amplitude", np.inf),
        ("amplitude", -1.0),
    ],
)
def test_echoes_refused_by_name(method: str, field: str, value: float) -> None:
    for at in (0, 17, 20):
        echoes = some_echoes(21, 10.0, 1.0)
        getattr(echoes, field)[at] = value
        with pytest.raises(ValueError, match=f"echo {at}: .*{field}"):
            frame_of(TABLE_2, echoes, method=method)


def test_arrays_refused() -> None:
    synthesizer, echoes, out = make(TABLE_2), some_echoes(4, 10.0, 1.0), np.empty((3, 64, 64))
    r, v, d, a = echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude
    for bad in (
        Echoes(r.astype(np.float32), v, d, a),
        Echoes(r, v[:3].copy(), d, a),
        Echoes(r, v, d[:, :2].copy(), a),
        Echoes(r, v, np.asfortranarray(d), a),
        Echoes(r, v, d, np.ones(8)[::2]),
    ):
        with pytest.raises(ValueError, match="must be a C-contiguous float64 array of shape"):
            synthesizer.synthesize(bad, out)
    for other in (np.empty((2, 64, 64)), np.empty((3, 64, 64), np.float32), np.empty((3, 64, 128))[:, :, ::2]):
        with pytest.raises(ValueError, match="out must be"):
            synthesizer.synthesize(echoes, other)
    out.flags.writeable = False
    with pytest.raises(ValueError, match="out must be writable"):
        synthesizer.synthesize(echoes, out)


def crowded(count: int) -> tuple[Echoes, Echoes]:
    """Return `count` echoes at each of three speeds one alias apart, so in the same cells, with others between them
    in the same panel; and the equivalent echoes: each place once, with the summed amplitude."""
    alias = 2.0 * TABLE_2.max_speed_mps
    speeds = np.array([0.7 - alias, 0.7, 0.7 + alias])
    between = some_echoes(200, 12.0, alias + 0.7)
    few = Echoes(
        np.concatenate([np.full(3, 4.2), between.range_m]),
        np.concatenate([speeds, between.speed_mps]),
        np.concatenate([np.tile([1.0, 0.0, 0.0], (3, 1)), between.direction_R]),
        np.concatenate([np.full(3, float(count)), between.amplitude]),
    )
    many = Echoes(
        np.concatenate([np.full(3 * count, 4.2), between.range_m]),
        np.concatenate([np.tile(speeds, count), between.speed_mps]),
        np.concatenate([np.tile([1.0, 0.0, 0.0], (3 * count, 1)), between.direction_R]),
        np.concatenate([np.ones(3 * count), between.amplitude]),
    )
    return many, few


def test_many_echoes_in_one_cell_keep_their_accuracy() -> None:
    """In single precision a cell that many echoes share is emptied into doubles time and again, in every plane."""
    many, few = crowded(70_000)
    exact = frame_of(TABLE_2, few, method="direct")
    synthesizer = make(TABLE_2)
    out = np.empty(synthesizer.shape)
    synthesizer.synthesize(some_echoes(20_000, 12.0, 20.0), out)  # its remains in the buffers must not matter
    report = synthesizer.synthesize(many, out)
    assert report.width > 0
    assert report.terms > 2 * report.panels  # two planes and more
    assert error(out, exact) < 2e-4  # 7e-4 if it were not emptied
