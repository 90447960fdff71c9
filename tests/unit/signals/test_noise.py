"""Noise streams: exactness of the normal transform, independence, repeatability, statistics."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
import scipy  # loads its packages when they are first used

from signals.noise import NoiseStream, normal_from_uniform


def test_inverse_normal_agrees_with_an_independent_one() -> None:
    p = np.concatenate([np.linspace(1e-6, 1 - 1e-6, 100_001), 10.0 ** np.linspace(-300, -1, 3001)])
    exact = scipy.special.ndtri(p)
    assert np.max(np.abs(normal_from_uniform(p) - exact) / np.maximum(np.abs(exact), 1e-3)) < 2e-14


def test_uniforms_stay_inside_the_open_interval() -> None:
    u = np.concatenate([NoiseStream(1, "a", lanes=8).uniform_block(b).ravel() for b in range(20)])
    assert u.min() > 0.0
    assert u.max() < 1.0
    assert np.all(1.0 - (1.0 - u) == u)


def test_draw_depends_only_on_seed_name_index_lane() -> None:
    forward = NoiseStream(5, "imu.white", lanes=3)
    backward = NoiseStream(5, "imu.white", lanes=3)
    indices = [0, 1, 255, 256, 257, 10_000, 511]
    assert [forward.normal(i) for i in indices] == [backward.normal(i) for i in indices[::-1]][::-1]


@pytest.mark.parametrize(("seed", "name"), [(6, "imu.white"), (5, "imu.whitf"), (5, "imu.bias")])
def test_other_seed_or_name_gives_other_noise(seed: int, name: str) -> None:
    a = NoiseStream(5, "imu.white").normal_block(0).ravel()
    b = NoiseStream(seed, name).normal_block(0).ravel()
    assert not np.isin(a, b).any()
    assert abs(np.corrcoef(a, b)[0, 1]) < 4.0 / np.sqrt(a.size)


def test_lanes_and_neighbours_are_uncorrelated_and_normal() -> None:
    stream = NoiseStream(11, "stat", lanes=4)
    x = np.concatenate([stream.normal_block(b) for b in range(400)])
    limit = 4.5 / np.sqrt(x.shape[0])
    assert np.all(np.abs(x.mean(axis=0)) < limit)
    assert np.all(np.abs(x.var(axis=0) - 1.0) < limit * np.sqrt(2.0))
    correlation = np.corrcoef(x.T) - np.eye(4)
    assert np.max(np.abs(correlation)) < limit
    for lag in (1, 2, 256):
        assert abs(np.mean(x[lag:, 0] * x[:-lag, 0])) < limit
    from scipy.stats import kstest  # here, as every process that collects tests imports the rest

    assert kstest(x.ravel(), "norm").pvalue > 1e-4


def test_bits_are_pinned() -> None:
    """A change here changes every recorded run: bump the recording schema if it is wanted."""
    block = NoiseStream(1, "golden", lanes=2).normal_block(3)
    assert hashlib.sha256(block.astype("<f8").tobytes()).hexdigest()[:16] == "6048acbbccac5c9d"


@pytest.mark.parametrize("lanes", [1, 3, 7, 42])
def test_samples_one_by_one_are_those_of_the_blocks_bit_for_bit(lanes: int) -> None:
    """numpy's own Philox makes the blocks: round the borders of blocks and pieces, far ones, and backwards."""
    stream = NoiseStream(5, "imu.white", lanes=lanes)
    blocks = {block: stream.normal_block(block).tolist() for block in (*range(6), 39062)}
    for index in [*range(1500), 10**7 - 3, 2, 255, 256, 257, 0]:
        assert list(stream.normal(index)) == blocks[index // 256][index % 256]


def test_no_lanes_is_refused() -> None:
    with pytest.raises(ValueError, match="lane"):
        NoiseStream(1, "x", lanes=0)
