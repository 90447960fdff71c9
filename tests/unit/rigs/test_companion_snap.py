"""Minimum-snap paths: optimality, continuity, waypoints, corridor, limits."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from tests.worlds.scripted_bench import CLIENT

from hil_companion.cuts import planning  # isort: skip
from hil_companion.cuts.planning import Limits, distances_m, least_snap, leg_times_s, plan  # isort: skip

assert CLIENT.is_dir()

LIMITS = Limits(4.0, 3.0, 0.4)
PATHS = {
    "square": np.array([[0, 0, 2], [10, 0, 2], [10, 10, 2], [0, 10, 2], [0, 0, 2.0]]),
    "uneven": np.array([[0, 0, 2], [40, 0, 2], [41, 0, 3], [41, 30, 3], [0, 0, 5.0]]),
    "back": np.array([[0, 0, 2], [10, 0, 2], [0, 0, 2.0]]),
    "lanes": np.array([[0, 0, 5], [30, 0, 5], [30, 3, 5], [0, 3, 5], [0, 6, 5], [30, 6, 5.0]]),
}


@pytest.fixture(params=PATHS)
def points(request: pytest.FixtureRequest) -> np.ndarray:
    return PATHS[request.param]


def test_rest_to_rest_is_the_known_polynomial() -> None:
    """Rest at both ends (v = a = j = 0) gives p = L (35 s^4 - 84 s^5 + 70 s^6 - 20 s^7)."""
    path = least_snap(np.array([[0, 0, 1], [3, 0, 1.0]]), np.array([2.5]))
    np.testing.assert_allclose(path.coefficients[0, :, 0], 3.0 * np.array([0, 0, 0, 0, 35, -84, 70, -20]), atol=1e-9)


def test_in_closed_form_derivatives_to_the_6th_are_continuous(points: np.ndarray) -> None:
    """Test the optimality condition with only the positions of the nodes given."""
    path = least_snap(points, leg_times_s(points, LIMITS))
    for k in range(7):
        size = np.abs([path.derivative(i, 1.0, k) for i in range(len(path.durations_s))]).max()
        for i in range(len(path.durations_s) - 1):
            np.testing.assert_allclose(
                path.derivative(i, 1.0, k), path.derivative(i + 1, 0.0, k), atol=1e-7 * (1 + size)
            )


@pytest.mark.parametrize("corridor_m", [0.4, 0.05, 1e-4])
def test_waypoints_rests_corridor_and_limits_are_kept(points: np.ndarray, corridor_m: float) -> None:
    path = plan(points, Limits(LIMITS.speed_mps, LIMITS.accel_mps2, corridor_m))
    starts_W = np.array([path.derivative(i, 0.0, 0) for i in range(len(path.durations_s))])
    at = [int(np.linalg.norm(starts_W - p_W, axis=1).argmin()) for p_W in points[:-1]]
    np.testing.assert_allclose(starts_W[at], points[:-1], atol=1e-7)
    np.testing.assert_allclose(path.at(path.duration_s).p_W, points[-1], atol=1e-7)
    for t_s in (0.0, path.duration_s):
        assert np.abs(path.at(t_s).v_W).max() < 1e-6
        assert np.abs(path.at(t_s).a_W).max() < 1e-6
    nodes_W = np.vstack([starts_W, points[-1]])
    assert distances_m(path, nodes_W).max() <= corridor_m * (1 + 1e-4)
    for first, second in pairwise(nodes_W):  # more waypoints lie on the legs
        ways = np.linalg.norm(points[:-1] - first, axis=1) + np.linalg.norm(points[1:] - second, axis=1)
        legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert np.abs(ways + np.linalg.norm(second - first) - legs).min() < 1e-6
    assert np.linalg.norm(path.sampled(1), axis=2).max() <= LIMITS.speed_mps
    assert np.linalg.norm(path.sampled(2), axis=2).max() <= LIMITS.accel_mps2
    for k in range(4):
        for i in range(len(path.durations_s) - 1):
            np.testing.assert_allclose(path.derivative(i, 1.0, k), path.derivative(i + 1, 0.0, k), atol=1e-6)


def test_a_stretched_path_goes_the_same_way() -> None:
    path = plan(PATHS["square"], LIMITS)
    slow = path.stretched(2.0)
    for t_s in np.linspace(0.0, path.duration_s, 50):
        fast_at, slow_at = path.at(t_s), slow.at(2.0 * t_s)
        np.testing.assert_allclose(slow_at.p_W, fast_at.p_W, atol=1e-9)
        np.testing.assert_allclose(2.0 * slow_at.v_W, fast_at.v_W, atol=1e-9)
        np.testing.assert_allclose(4.0 * slow_at.a_W, fast_at.a_W, atol=1e-9)


def test_velocity_and_acceleration_are_derivatives_of_the_position() -> None:
    path, h = plan(PATHS["square"], LIMITS), 1e-5
    for t_s in np.linspace(0.5, path.duration_s - 0.5, 40):
        before, here, after = (path.at(t_s + d) for d in (-h, 0.0, h))
        np.testing.assert_allclose((after.p_W - before.p_W) / (2 * h), here.v_W, atol=1e-5)
        np.testing.assert_allclose((after.v_W - before.v_W) / (2 * h), here.a_W, atol=1e-5)


def test_many_waypoints_are_flown_in_pieces_and_repeats_are_one() -> None:
    many = np.array([[3.0 * i, 2.0 * (i % 2), 2.0] for i in range(2 * planning.MAX_LEGS + 3)])
    path = plan(np.repeat(many, 2, axis=0), Limits(4.0, 3.0, 10.0))
    assert len(path.durations_s) == len(many) - 1
    np.testing.assert_allclose(path.at(path.duration_s).p_W, many[-1], atol=1e-7)
    with pytest.raises(ValueError, match="two waypoints"):
        plan(np.zeros((3, 3)), LIMITS)


PLAN = """
import sys
import numpy as np
from hil_companion.cuts.planning import Limits, plan
points_W = np.array([[0, 0, 10], [20, 0, 10], [20, 25, 10], [-20, 25, 12], [-20, 0, 10], [3, 1, 8]], float)
path = plan(points_W, Limits(4.0, 2.5, 0.25))
for t_s in np.linspace(0.0, path.duration_s, 200):
    sys.stdout.buffer.write(np.concatenate(path.at(t_s)).tobytes())
"""


def test_a_plan_is_the_same_with_every_blas_number_of_threads_and_libm() -> None:
    def planned(**environment: str) -> bytes:
        env = os.environ | environment | {"PYTHONPATH": str(CLIENT)}
        return subprocess.run([sys.executable, "-c", PLAN], env=env, capture_output=True, check=True).stdout

    bits = planned()
    assert len(bits) == 200 * 9 * 8
    for core in ("Sandybridge", "Haswell"):
        assert planned(OPENBLAS_CORETYPE=core) == bits
    assert planned(OPENBLAS_NUM_THREADS="1") == bits
    assert planned(GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable") == bits
