"""Arrays whose elements differ: every sample against the plain sum of the equation, with gains and phases by angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sim.radar.antenna import Antenna, Pattern
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.echoes import Echoes
from sim.radar.element_cuts import ElementCuts
from sim.radar.element_synthesis import ElementSynthesizer
from sim.radar.synthesis import Synthesizer

PATTERN = Pattern(gain_dbi=10.0, azimuth_beamwidth_deg=56.0, elevation_beamwidth_deg=28.0)
CHIRP = Chirp(
    center_frequency_hz=77.5e9, bandwidth_hz=0.8e9, samples=64, sample_rate_hz=6.25e6, chirps=24,
    repetition_s=58e-6, sampling="complex",
)  # fmt: skip
RX, TX = ((0.0, 0.0, 0.0), (0.0, 0.00195, 0.0)), ((0.0, 0.0, 0.0), (0.0, 0.0078, 0.0), (0.0, 0.0039, 0.00195))
RX_CUTS = (
    ElementCuts(azimuth=((-60.0, -2.0, 30.0), (0.0, 0.0, 0.0), (60.0, 1.0, -50.0))),
    ElementCuts(elevation=((-20.0, 0.5, 10.0), (20.0, -3.0, 90.0))),
)
TX_CUTS = (
    ElementCuts(),
    ElementCuts(azimuth=((0.0, -1.5, 45.0),)),
    ElementCuts(azimuth=((-90.0, 0.0, 0.0), (90.0, -6.0, 180.0))),
)
ANTENNA = Antenna(rx_positions_m=RX, tx_positions_m=TX, tx=PATTERN, rx=PATTERN, rx_cuts=RX_CUTS, tx_cuts=TX_CUTS)


def echoes_of(*, other_way_out: bool) -> Echoes:
    rng = np.random.Generator(np.random.Philox(3))

    def directions() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        d = np.stack([np.ones(20), rng.uniform(-1.0, 1.0, 20), rng.uniform(-0.4, 0.4, 20)], axis=1)
        return np.ascontiguousarray(d / np.linalg.norm(d, axis=1)[:, None])

    return Echoes(
        rng.uniform(2.0, 10.0, 20), rng.uniform(-5.0, 5.0, 20), directions(), rng.uniform(1.0, 10.0, 20),
        directions() if other_way_out else None,
    )  # fmt: skip


def lookup(cuts: ElementCuts, d: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, float]:
    """Return decibels and turns by np.interp."""
    total_db, total_deg = 0.0, 0.0
    angles = math.degrees(math.atan2(d[1], d[0])), math.degrees(math.atan2(d[2], math.hypot(d[0], d[1])))
    for rows, angle in zip((cuts.azimuth, cuts.elevation), angles, strict=True):
        if rows is not None:
            total_db += float(np.interp(angle, [row[0] for row in rows], [row[1] for row in rows]))
            total_deg += float(np.interp(angle, [row[0] for row in rows], [row[2] for row in rows]))
    return total_db, total_deg / 360.0


@pytest.mark.parametrize("other_way_out", [False, True])
@pytest.mark.parametrize(("method", "limit"), [("direct", 2e-4), ("nufft", 1e-3)])
def test_every_sample_is_the_equation(method: str, limit: float, *, other_way_out: bool) -> None:
    """Phases are delays: in proportion to the frequency of the sweep. The limit is that of its change by tau."""
    echoes = echoes_of(other_way_out=other_way_out)
    leaves = echoes.direction_R if echoes.out_direction_R is None else echoes.out_direction_R
    out = np.empty((len(RX) * 2, CHIRP.chirps, CHIRP.samples))
    plain: dict[str, float | None] = {"hp_cutoff_hz": None, "aaf_cutoff_hz": None}
    ElementSynthesizer(CHIRP, ANTENNA, **plain, method=method, tolerance=1e-3).synthesize(echoes, out)
    n = np.arange(CHIRP.samples)
    expected = np.zeros((len(RX), CHIRP.chirps, CHIRP.samples), complex)
    for i in range(len(echoes.range_m)):
        for m in range(CHIRP.chirps):
            p = m % len(TX)
            t = (m - (CHIRP.chirps - 1) / 2) * CHIRP.repetition_s + (n - (CHIRP.samples - 1) / 2) / CHIRP.sample_rate_hz
            tau = 2.0 * (echoes.range_m[i] + echoes.speed_mps[i] * t) / SPEED_OF_LIGHT_MPS
            cycles = CHIRP.start_frequency_hz * tau % 1.0
            cycles += CHIRP.slope_hz_per_s * (n / CHIRP.sample_rate_hz * tau - tau**2 / 2.0)
            for k in range(len(RX)):
                way = np.dot(TX[p], leaves[i]) + np.dot(RX[k], echoes.direction_R[i])
                gains, turns = zip(
                    lookup(TX_CUTS[p], leaves[i]), lookup(RX_CUTS[k], echoes.direction_R[i]), strict=True
                )
                sweep = (
                    CHIRP.start_frequency_hz + CHIRP.slope_hz_per_s * n / CHIRP.sample_rate_hz
                ) / CHIRP.center_frequency_hz
                phase = 2.0 * math.pi * (cycles - way / CHIRP.wavelength_m + sum(turns) * sweep)
                expected[k, m] += echoes.amplitude[i] * 10.0 ** (sum(gains) / 20.0) * np.exp(1j * phase)
    assert np.linalg.norm(out[0::2] + 1j * out[1::2] - expected) < limit * np.linalg.norm(expected)


def test_equal_elements_are_the_array() -> None:
    antenna = Antenna(rx_positions_m=RX, tx_positions_m=TX, tx=PATTERN, rx=PATTERN, rx_cuts=(ElementCuts(),) * 2)
    echoes, shape = echoes_of(other_way_out=False), (len(RX) * 2, CHIRP.chirps, CHIRP.samples)
    out, whole = np.empty(shape), np.empty(shape)
    filters: dict[str, Any] = {"hp_cutoff_hz": 175e3, "aaf_cutoff_hz": 5e6, "method": "direct", "tolerance": 1e-3}
    ElementSynthesizer(CHIRP, antenna, **filters).synthesize(echoes, out)
    Synthesizer(CHIRP, antenna.array, **filters).synthesize(echoes, whole)
    # The filters' values are those of the range in the middle of each transmitter's chirps, fractions of a mm apart.
    assert np.linalg.norm(out - whole) < 1e-4 * np.linalg.norm(whole)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rx_cuts": ({},)}, "rx_cuts has 1 elements; rx_positions_m has 2"),
        ({"tx_cuts": ({}, {}, {}), "mimo": "ddm"}, "transmitters that take turns"),
        ({"rx_cuts": ({"azimuth": ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, {})}, "must have rising angles"),
    ],
)
def test_cuts_that_do_not_fit(changed: dict[str, object], message: str) -> None:
    plain = {"rx_positions_m": RX, "tx_positions_m": TX, "tx": PATTERN.model_dump(), "rx": PATTERN.model_dump()}
    with pytest.raises(ValueError, match=message):
        Antenna.model_validate(plain | changed)
