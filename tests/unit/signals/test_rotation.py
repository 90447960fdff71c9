"""Rotations of the leaf against SciPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # loads its packages when they are first used

from signals._kernel import quaternion_of_axes, roll_pitch_yaw, rotate_into_body, rotate_into_world
from signals.rotation import applied, conjugate, cos_tilt_of, matrix_of, product, yaw_of

Q = [tuple((q / np.linalg.norm(q)).tolist()) for q in np.random.default_rng(3).normal(size=(200, 4))]
VECTORS = np.random.default_rng(4).normal(size=(200, 3)).tolist()


def turns() -> Any:
    """Return SciPy's rotations of Q."""
    return scipy.spatial.transform.Rotation.from_quat(Q, scalar_first=True)


def test_products_and_matrices_are_scipys() -> None:
    for one, other, a, b in zip(turns(), turns()[::-1], Q, Q[::-1], strict=True):
        both = (one * other).as_matrix()
        np.testing.assert_allclose(np.reshape(matrix_of(product(a, b)), (3, 3)), both, atol=1e-14)
        np.testing.assert_allclose(matrix_of(conjugate(a)), one.inv().as_matrix().ravel(), atol=1e-14)


def test_arrays_of_quaternions_give_the_same_bits_as_one_by_one() -> None:
    rows = np.array(Q)
    together = np.stack(product(rows.T, rows[::-1].T), -1)
    assert together.tolist() == [list(product(a, b)) for a, b in zip(Q, Q[::-1], strict=True)]
    assert np.stack(matrix_of(rows.T), -1).tolist() == [list(matrix_of(q)) for q in Q]


def test_vectors_turn_as_scipy_turns_them_and_back() -> None:
    for turn, q, v in zip(turns(), Q, VECTORS, strict=True):
        there = rotate_into_world(q, tuple(v))
        np.testing.assert_allclose(there, turn.apply(v), atol=1e-13)
        np.testing.assert_allclose(applied(matrix_of(q), tuple(v)), there, atol=1e-13)
        np.testing.assert_allclose(rotate_into_body(q, there), v, atol=1e-13)


def test_angles_are_those_of_z_y_x() -> None:
    for turn, q in zip(turns(), Q, strict=True):
        yaw, pitch, roll = turn.as_euler("ZYX")
        np.testing.assert_allclose(roll_pitch_yaw(q), (roll, pitch, yaw), atol=1e-12)
        np.testing.assert_allclose(yaw_of(q), yaw, atol=1e-13)
        np.testing.assert_allclose(cos_tilt_of(q), turn.as_matrix()[2, 2], atol=1e-14)


def test_axes_give_their_quaternion_for_every_largest_component() -> None:
    for q in [*Q, (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)]:
        made = quaternion_of_axes(*np.reshape(matrix_of(q), (3, 3)).T.tolist())
        assert abs(abs(np.dot(made, q)) - 1.0) < 1e-14
