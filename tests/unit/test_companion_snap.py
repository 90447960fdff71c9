"""Paths of least snap: optimality, continuity, waypoints, corridor, limits, and the way round a missing solver."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unit.companion_bench import CLIENT

from hil_companion.cuts import corridor, planning  # isort: skip
from hil_companion.cuts.planning import Limits, leg_times_s, plan, with_stops  # isort: skip
from hil_companion.cuts.snap_path import SAMPLES, SnapPath  # isort: skip
from hil_companion.cuts.snap_program import SnapProgram  # isort: skip

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


def parts_of(path: SnapPath, points: np.ndarray) -> int:
    return len(path.durations_s) // (len(points) - 1)


def test_rest_to_rest_is_the_known_polynomial() -> None:
    """With v = a = j = 0 at both ends: p = L (35 s^4 - 84 s^5 + 70 s^6 - 20 s^7), snap cost 100800 L^2 / T^7."""
    program = SnapProgram(np.array([[0, 0, 1], [3, 0, 1.0]]), np.array([2.5]))
    path = program.path(program.least())
    np.testing.assert_allclose(path.coefficients[0, :, 0], 3.0 * np.array([0, 0, 0, 0, 35, -84, 70, -20]), atol=1e-9)
    assert path.snap_cost() == pytest.approx(100_800 * 9.0 / 2.5**7, rel=1e-9)


def test_in_closed_form_the_gradient_is_zero_and_derivatives_to_the_6th_are_continuous(points: np.ndarray) -> None:
    program = SnapProgram(points, leg_times_s(points, LIMITS))
    x = program.least()
    assert np.abs(program.H @ x + program.g).max() < 1e-8 * np.abs(program.g).max()
    path = program.path(x)
    for k in range(7):
        size = np.abs([path.derivative(i, 1.0, k) for i in range(len(path.durations_s))]).max()
        for i in range(len(path.durations_s) - 1):
            np.testing.assert_allclose(
                path.derivative(i, 1.0, k), path.derivative(i + 1, 0.0, k), atol=1e-7 * (1 + size)
            )


def test_cost_is_the_integral_of_squared_snap(points: np.ndarray) -> None:
    path = with_stops(points, LIMITS)
    snap2 = np.sum(path.sampled(4) ** 2, axis=2)
    weights = np.full(SAMPLES + 1, 2.0)  # Simpson
    weights[1::2], weights[0], weights[-1] = 4.0, 1.0, 1.0
    integral = float(np.sum((snap2 @ weights) * path.durations_s / (3.0 * SAMPLES)))
    assert path.snap_cost() == pytest.approx(integral, rel=1e-4)


def test_with_the_corridor_the_conditions_of_an_optimum_hold() -> None:
    """Stationarity, feasibility, signs of the multipliers, complementarity."""
    points = PATHS["uneven"]
    program = SnapProgram(points, leg_times_s(points, LIMITS))
    samples = [(i, j) for i in range(4) for j in range(8, SAMPLES, 8)]
    found = corridor.solve(program, samples, LIMITS.corridor_m)
    assert found is not None
    x, y = found.x, found.multipliers
    assert np.abs(found.H @ x + found.g + found.A.T @ y).max() < 1e-6 * np.abs(found.g).max()
    value = found.A @ x
    assert np.all(value >= found.low - 1e-7)
    assert np.all(value <= found.high + 1e-7)
    held = found.high > found.low  # the corridor's rows; the others are equalities
    below, above = held & (y < -1e-7), held & (y > 1e-7)
    np.testing.assert_allclose(value[below], found.low[below], atol=1e-6)
    np.testing.assert_allclose(value[above], found.high[above], atol=1e-6)
    assert below.any() or above.any()  # else the corridor did not matter, and nothing was tested
    free = program.path(program.least())
    assert corridor.distances_m(free, points).max() > LIMITS.corridor_m
    assert program.path(x.reshape(3, -1).T).snap_cost() > free.snap_cost()


@pytest.mark.parametrize("solver", [True, False])
def test_waypoints_rests_corridor_and_limits_are_kept(points: np.ndarray, solver: bool) -> None:
    path = plan(points, LIMITS, solver=solver)
    parts = parts_of(path, points)
    for i, p_W in enumerate(points[:-1]):
        np.testing.assert_allclose(path.derivative(i * parts, 0.0, 0), p_W, atol=1e-7)
    np.testing.assert_allclose(path.at(path.duration_s).p_W, points[-1], atol=1e-7)
    for t_s in (0.0, path.duration_s):
        assert np.abs(path.at(t_s).v_W).max() < 1e-6
        assert np.abs(path.at(t_s).a_W).max() < 1e-6
    assert corridor.distances_m(path, points, parts).max() <= LIMITS.corridor_m * (1 + 1e-4)
    assert np.linalg.norm(path.sampled(1), axis=2).max() <= LIMITS.speed_mps
    assert np.linalg.norm(path.sampled(2), axis=2).max() <= LIMITS.accel_mps2
    for k in range(5 if solver else 4):
        for i in range(len(path.durations_s) - 1):
            np.testing.assert_allclose(path.derivative(i, 1.0, k), path.derivative(i + 1, 0.0, k), atol=1e-6)


def test_flying_through_costs_no_more_snap_than_stopping_in_the_same_times(points: np.ndarray) -> None:
    times_s = leg_times_s(points, LIMITS)
    through = corridor.path_within(SnapProgram(points, times_s, parts=2), LIMITS.corridor_m)
    stopping = SnapProgram(points, times_s, stops=range(len(points)))
    assert through is not None
    assert through.snap_cost() < stopping.path(stopping.least()).snap_cost()


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
    path = plan(np.repeat(many, 2, axis=0), LIMITS, solver=False)
    assert len(path.durations_s) == len(many) - 1
    np.testing.assert_allclose(path.at(path.duration_s).p_W, many[-1], atol=1e-7)
    with pytest.raises(ValueError, match="two waypoints"):
        plan(np.zeros((3, 3)), LIMITS)


def test_nothing_is_printed_by_the_solver(capfd: pytest.CaptureFixture[str]) -> None:
    plan(PATHS["uneven"], LIMITS)
    assert capfd.readouterr() == ("", "")
