"""The smear of a peak by range migration, against the transform of the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from sim.radar.processing.migration import Migration
from sim.radar.processing.parameters import WindowName
from sim.radar.processing.windows import window


@pytest.mark.parametrize("name", ["hann", "taylor", "none"])
def test_the_response_is_that_of_moving_samples(name: WindowName) -> None:
    n, m, padded_n, padded_m = 48, 20, 64, 32
    fast, slow = window(name, n), window(name, m)
    migration = Migration(fast, padded_n, slow, padded_m)
    nu, mu = np.arange(n) - 0.5 * (n - 1), np.arange(m) - 0.5 * (m - 1)
    for x, y, c in ((0.0, 0.0, 0.0), (0.3, -0.4, 0.05), (-1.2, 0.7, -0.1), (0.8, 1.0, 0.02)):
        # An echo c mu cells away at pulse mu, seen at x and y from its place.
        turn = -(x - c * mu[:, None]) * nu / padded_n - y * mu[:, None] / padded_m
        expected = np.sum(np.outer(slow, fast) * np.exp(2j * np.pi * turn))
        re, im = migration._response(*(np.array([value]) for value in (x, y, c)))
        assert re[0] + 1j * im[0] == pytest.approx(expected, abs=2e-4 * n * m)


def test_echoes_at_rest_stay_as_they_were_read() -> None:
    migration = Migration(window("hann", 48), 64, window("hann", 20), 32)
    off = (np.array([0.2, -0.3]), np.array([0.1, 0.4]))

    def unused(*_: object) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        raise AssertionError

    found = migration.corrected(off, np.zeros(2), (unused, unused))
    assert (found[0].tolist(), found[1].tolist()) == (off[0].tolist(), off[1].tolist())
    assert migration.phases(off, np.zeros(2), 0.3).tolist() == [0.0, 0.0]
