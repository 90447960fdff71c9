"""On the ground in wind: the land detector, a clipped accelerometer, and a position that comes back after the flare."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from firmware_bridge.mock_pixhawk.estimate.sensors import CLIPPED_NOISE, CLIPPED_US, IMU_BITS, SensorIntake
from firmware_bridge.mock_pixhawk.flight.failsafe import Action
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.land_detector import PlaneLandDetector
from firmware_bridge.mock_pixhawk.plane.plane_stack import PlaneFailsafe

STEP_US = 20_000


@pytest.mark.parametrize(("airspeed", "landed"), [(5.0, True), (12.0, False)])
def test_at_rest_in_wind(airspeed: float, landed: bool) -> None:
    """LNDFW_AIRSPD_MAX is 6 m/s: below, landed after 2 s; above, never, and that is what it says."""
    detector = PlaneLandDetector(ParamTable.of_firmware(plane=True))
    now = 0
    for _ in range(50):
        now += STEP_US
        detector.step(now, (15.0, 0.0, 0.0), -20.0, 15.0, moves=True)
    assert not detector.landed
    for _ in range(400):
        now += STEP_US
        detector.step(now, (0.0, 0.0, 0.0), 0.0, airspeed, moves=False)
    assert detector.landed is landed
    assert detector.blown is not landed


def test_a_clipped_accelerometer_is_doubted_for_half_a_second() -> None:
    noises: list[tuple[int, int, float]] = []
    now = 0
    core: Any = SimpleNamespace(
        step_fifo=lambda *_: True, set_param=lambda index, value: noises.append((now, index, value))
    )
    intake = SensorIntake(core)
    intake.doubt_clipped(7, lambda: 0.01)
    for i in range(300):
        now = 4000 * i
        up = -157.0 if i == 50 else -9.81
        intake.take(now, (now, 0.0, 0.0, up, *[0.0] * 10, IMU_BITS, 0), bytes(65))
    assert noises == [(200_000, 7, CLIPPED_NOISE), (200_000 + CLIPPED_US, 7, 0.01)]


@pytest.mark.parametrize(
    ("flaring", "airspeed", "action"),
    [
        pytest.param(True, 12.0, None, id="in the flare"),
        pytest.param(False, 3.0, None, id="too slow to fly"),
        pytest.param(False, 15.0, Action.HOLD, id="in flight"),
    ],
)
def test_a_position_that_comes_back_does_not_take_off(flaring: bool, airspeed: float, action: Action | None) -> None:
    stack: Any = SimpleNamespace(
        landing=SimpleNamespace(flaring=flaring), air=SimpleNamespace(airspeed_mps=airspeed), engine=None
    )
    vehicle: Any = SimpleNamespace(mode=Mode.MISSION, failsafe=False)
    estimate: Any = SimpleNamespace(position_ok=False)
    none: Any = None
    params = ParamTable.of_firmware(plane=True)
    parts = FirmwareParts(none, vehicle, estimate, none, params, none)
    failsafe = PlaneFailsafe(stack, parts, none, lambda *_: None)
    assert failsafe._position(0) is None
    estimate.position_ok = True
    assert failsafe._position(STEP_US) is action
