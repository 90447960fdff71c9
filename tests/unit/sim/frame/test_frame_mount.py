"""A camera's mount: its direction, its motion with the vehicle, and the accuracy of its pose between ticks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from signals.rotation import matrix_of
from signals.samples import TruthState
from sim.frame.mount import Mount, moved
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

ZERO = (0.0, 0.0, 0.0)
LEVEL = (1.0, 0.0, 0.0, 0.0)


def truth(**values: object) -> TruthState:
    state = TruthState(0, 0, ZERO, LEVEL, ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return state._replace(**values)  # type: ignore[arg-type]


def axes(rpy_deg: tuple[float, float, float], *, optical: bool = True) -> list[tuple[float, ...]]:
    """x, y and z of the sensor's frame, in B."""
    R = np.array(Mount(ZERO, rpy_deg, optical=optical).pose(truth()).R_WC).reshape(3, 3)
    return [tuple(round(v, 12) + 0.0 for v in R[:, i]) for i in range(3)]


@pytest.mark.parametrize(
    ("rpy_deg", "right", "down", "view"),
    [
        ((0, 0, 0), (0, -1, 0), (0, 0, -1), (1, 0, 0)),  # forward
        ((0, 90, 0), (0, -1, 0), (-1, 0, 0), (0, 0, -1)),  # down; the top of the picture is forward
        ((0, 0, 90), (1, 0, 0), (0, 0, -1), (0, 1, 0)),  # left
        ((0, 0, 180), (0, 1, 0), (0, 0, -1), (-1, 0, 0)),  # back
        ((90, 0, 0), (0, 0, -1), (0, 1, 0), (1, 0, 0)),  # forward, rolled to the right
    ],
)
def test_the_camera_looks_where_its_angles_say(rpy_deg, right, down, view) -> None:
    assert axes(rpy_deg) == [right, down, view]


def test_a_lidar_has_the_axes_of_the_body() -> None:
    assert axes((0, 0, 0), optical=False) == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    assert axes((0, 0, 90), optical=False) == [(0, 1, 0), (-1, 0, 0), (0, 0, 1)]


def test_pose_and_velocity_are_those_of_the_place_on_the_vehicle() -> None:
    half = math.sqrt(0.5)
    mount = Mount((0.2, 0.0, 0.1), ZERO)
    state = truth(p_WB=(1.0, 2.0, 3.0), q_WB=(half, 0, 0, half), v_WB_W=(0.5, 0.0, 0.0), w_WB_B=(0.0, 0.0, 2.0))
    pose = mount.pose(state)
    assert pose.p_WC == pytest.approx((1.0, 2.2, 3.1), abs=1e-12)  # facing north
    assert pose.w_WC_W == pytest.approx((0.0, 0.0, 2.0), abs=1e-12)
    assert pose.v_WC_W == pytest.approx((0.5 - 0.4, 0.0, 0.0), abs=1e-12)
    assert np.allclose(pose.R_WC, matrix_of(mount.attitude(state)), atol=1e-15)
    # The velocity is the derivative of the place.
    step = 1e-6
    ahead, behind = np.array(mount.pose(state, step).p_WC), np.array(mount.pose(state, -step).p_WC)
    assert (ahead - behind) / (2.0 * step) == pytest.approx(pose.v_WC_W, abs=1e-8)


def test_the_pose_between_ticks_is_as_exact_as_it_says() -> None:
    tick_ns = 4_000_000
    physics = VehiclePhysics(
        load_vehicle("x500"), load_scene("airfield"), tick_ns, start=FlightStart(p_WB=(0.0, 0.0, 300.0))
    )
    h = multirotor.hover_control(physics.vehicle)
    states = [physics.advance(0, (h,) * 4)]
    for k in range(1, 300):
        s = 0.1 * math.sin(0.05 * k)
        states.append(physics.advance(k, (h + s, h - s, h + 0.5 * s, h - 0.3 * s)))
    assert max(abs(x) for state in states for x in state.alpha_WB_B) > 20.0  # it does wobble
    for ticks, limit_m, limit_deg in ((2, 1e-5, 4e-3), (3, 3e-5, 0.011), (-2, 1e-5, 4e-3), (-3, 3e-5, 0.011)):
        for k in range(20, 280):
            p, q, v, w = moved(states[k], ticks * tick_ns * 1e-9)
            then = states[k + ticks]
            assert np.linalg.norm(np.subtract(p, then.p_WB)) < limit_m
            turn = 2.0 * math.degrees(math.acos(min(1.0, abs(float(np.dot(q, then.q_WB))))))
            assert turn < limit_deg
            assert np.linalg.norm(np.subtract(v, then.v_WB_W)) < 0.01
            assert np.linalg.norm(np.subtract(w, then.w_WB_B)) < 0.05


def test_moved_by_nothing_is_where_it_was() -> None:
    state = truth(p_WB=(1.0, 2.0, 3.0), w_WB_B=(1.0, 2.0, 3.0), v_WB_W=(4.0, 5.0, 6.0))
    assert moved(state, 0.0) == (state.p_WB, state.q_WB, state.v_WB_W, state.w_WB_B)
