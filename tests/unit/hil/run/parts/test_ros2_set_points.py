"""Set-points from ROS 2: a velocity of the vehicle turns with its heading, however it is tilted."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from scipy.spatial.transform import Rotation

from hil.run.parts.links.ros2.set_points import Frames, desired_velocity, heading_of
from signals.samples import TruthState

ZERO = (0.0, 0.0, 0.0)
TWIST = SimpleNamespace(linear=SimpleNamespace(x=2.0, y=1.0, z=0.5), angular=SimpleNamespace(z=0.3))


@pytest.mark.parametrize("yaw_deg", [-120.0, 0.0, 70.0])
@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (25.0, -40.0), (-10.0, 30.0)])
def test_a_velocity_turns_with_the_heading_alone(yaw_deg: float, pitch_deg: float, roll_deg: float) -> None:
    turns = Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True)
    w, x, y, z = turns.as_quat(scalar_first=True)
    assert math.degrees(heading_of((w, x, y, z))) == pytest.approx(yaw_deg)
    truth = TruthState(0, 0, ZERO, (w, x, y, z), ZERO, ZERO, ZERO, ZERO, (), False)
    frames = Frames("base_link", ("map",))
    about_z = Rotation.from_euler("Z", yaw_deg, degrees=True).apply((2.0, 1.0, 0.5))
    for frame, expected in (("base_link", about_z), ("", about_z), ("map", (2.0, 1.0, 0.5))):
        desired = desired_velocity(TWIST, frame, truth, frames)
        assert desired.v_W == pytest.approx(expected)
        assert desired.yaw_rate_radps == 0.3
