"""The native limbs of a walker are those of the equations in Python, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim._kernels import walker_pose
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.gait import Gait, natural_cycle_m
from sim.scene.maps.walk_path import WalkPath
from sim.scene.maps.walker import Walker

STILL = (0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0)  # at the origin, along x; a phase a second


def arrays() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    n = len(LIMBS)
    return np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))


@settings(max_examples=60, deadline=None)
@given(st.floats(1.0, 2.1), st.floats(0.4, 2.2), st.floats(0.0, 1.0, exclude_max=True))
def test_limbs_are_those_of_the_equations(height_m: float, speed_mps: float, phase: float) -> None:
    figure = Figure(height_m)
    gait = Gait(figure, speed_mps, natural_cycle_m(figure, speed_mps))
    p, q, v, w = arrays()
    walker_pose(gait.kernel_values, phase, STILL, p, q, v, w)
    rows = np.array(gait.rows(phase))
    assert p.tobytes() == (rows[:, :3] + 0.0).tobytes()
    assert q[:, 0].tobytes() == (rows[:, 5] * rows[:, 3]).tobytes()  # cos of half the yaw, of half the pitch
    assert q[:, 2].tobytes() == (rows[:, 5] * rows[:, 4]).tobytes()
    assert np.array_equal(v, rows[:, 7:10] + np.array([1.0, 0.0, 0.0]))
    assert np.array_equal(w[:, 2], rows[:, 11])


def test_velocities_are_the_derivatives_of_the_poses() -> None:
    walker = Walker("w", Figure(1.7), WalkPath([(0.0, 0.0), (6.0, 0.0), (5.0, 5.0)], 1.3))
    step_ns = 1_000_000
    for t_ns in range(10_000_000, 20_000_000_000, 777_777_777):
        p, q, v, w = arrays()
        walker.pose(t_ns, p, q, v, w)
        before, after = arrays(), arrays()
        walker.pose(t_ns - step_ns, *before)
        walker.pose(t_ns + step_ns, *after)
        slope = (after[0] - before[0]) / (2e-9 * step_ns)
        assert np.abs(slope - v).max() < 2e-3
        assert np.abs(np.sum(q * q, axis=1) - 1.0).max() < 1e-12


def test_refusals() -> None:
    shape = Gait(Figure(1.7), 1.2, 1.4).kernel_values
    p, q, v, w = arrays()
    with pytest.raises(ValueError, match="phase"):
        walker_pose(shape, 1.5, STILL, p, q, v, w)
    with pytest.raises(TypeError):
        walker_pose(shape[:-1], 0.5, STILL, p, q, v, w)
    with pytest.raises(TypeError):
        walker_pose(shape, 0.5, STILL, p[:-1], q, v, w)
