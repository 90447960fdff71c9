"""Angles of the report's attitude figure, against SciPy's Euler angles."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hil.run.report.figures import roll_pitch_yaw_deg, without_jumps


def test_roll_pitch_and_yaw_are_those_of_the_turns() -> None:
    angles_deg = np.random.default_rng(1).uniform((-170.0, -80.0, -170.0), (170.0, 80.0, 170.0), (50, 3))
    q_WB = Rotation.from_euler("ZYX", angles_deg[:, ::-1], degrees=True).as_quat(scalar_first=True)
    np.testing.assert_allclose(roll_pitch_yaw_deg(q_WB), angles_deg, atol=1e-9)


def test_a_line_has_a_gap_where_the_angle_wraps() -> None:
    np.testing.assert_array_equal(
        without_jumps(np.array([170.0, 179.0, -179.0, -90.0, 89.0])), [170, 179, np.nan, -90, 89]
    )
