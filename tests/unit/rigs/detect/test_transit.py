"""Transit of walkers: densities that integrate to one, and who walks on, back, or is somebody else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.locate import transit  # noqa: E402
from hil_companion.locate.tracks import FIRST_SPEED_MPS, Fix, Sighting, Track, Tracks  # noqa: E402
from hil_companion.locate.transit import transit_ratio  # noqa: E402

SECOND = 1_000_000_000


def seen_at(x: float, y: float) -> Sighting:
    return Sighting("person", (x, y, 0.9), np.eye(2) * 0.04)


def walked(from_s: float, x: float, y: float, *, v: tuple[float, float] = (1.2, 0.0), count: int = 12) -> Track:
    """Return the track of somebody who walks from a place."""
    tracks = Tracks()
    for k in range(count):
        t_s = 0.25 * k
        tracks.add(round((from_s + t_s) * SECOND), [seen_at(x + v[0] * t_s, y + v[1] * t_s)])
    (track,) = tracks.tracks
    return track


@pytest.mark.parametrize("dt_s", [2.0, 8.0, 15.0])
def test_the_place_of_who_walks_on_or_back_is_a_density(dt_s: float) -> None:
    a, b = walked(0.0, 0.0, 0.0), walked(2.75 + dt_s, 0.0, 0.0)
    b.first = Fix(b.first_ns, b.first.state, b.first.sigma_m, FIRST_SPEED_MPS)  # its velocity is not known
    step_m, half_m = 0.4, 80.0
    grid = np.arange(-half_m, half_m, step_m)
    sums = np.zeros(2)
    for x in grid:
        for y in grid[np.abs(grid) < 40.0]:
            sums += transit._along_path(a, b, np.array([x, y]), dt_s, 0.3)
    assert sums * step_m**2 == pytest.approx([1.0, 1.0], abs=0.02)


def test_a_velocity_says_on_average_nothing_of_somebody_else() -> None:
    b = walked(0.0, 0.0, 0.0)
    known2, any2 = 0.3**2, FIRST_SPEED_MPS**2
    step = 0.05
    grid = np.arange(-4.0, 4.0, step)
    total = weights = 0.0
    shrunk2 = any2 - known2  # variance of the estimates of anyone's velocity
    for vx in grid:
        for vy in grid:
            b.first = Fix(0, np.array([0.0, 0.0, vx, vy]), 0.2, math.sqrt(known2))
            weight = math.exp(-0.5 * (vx**2 + vy**2) / shrunk2) / (2.0 * math.pi * shrunk2) * step**2
            total += weight * transit._heads(b, np.array([1.2, 0.0]), 0.05)
            weights += weight
    assert weights == pytest.approx(1.0, abs=1e-3)
    assert total == pytest.approx(1.0, abs=0.02)


def test_who_walks_on_is_likelier_than_who_comes_the_other_way() -> None:
    a = walked(0.0, 0.0, 0.0)
    x = 1.2 * 11.0  # eight seconds after the end of a, where it would be
    on = transit_ratio(a, walked(11.0, x, 0.0))
    other_way = transit_ratio(a, walked(11.0, x, 0.0, v=(-1.2, 0.0)))
    turned = transit_ratio(a, walked(11.0, 0.5, 0.0, v=(-1.2, 0.0)))
    beside = transit_ratio(a, walked(11.0, 3.0, 11.0, v=(0.0, 1.2)))
    assert on > other_way + 2.0
    assert on > turned > beside
    assert on > 3.0
    assert turned > 0.5


def test_a_second_box_at_the_end_of_a_track_is_the_same_body_and_one_beside_it_is_not() -> None:
    a = walked(0.0, 0.0, 0.0)  # ends at 2.75 s at 3.3 m
    assert transit_ratio(a, walked(2.25, 2.7, 0.1)) > 3.0
    assert transit_ratio(a, walked(2.25, 2.7, 1.2)) == -math.inf
    assert transit_ratio(a, walked(1.0, 1.2, 0.0)) == -math.inf  # both for too long
