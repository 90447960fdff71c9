"""ArduPlane's parameters for a tiltrotor: hinges against its own law, and the torque with which they steer the yaw."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, pi, radians, sin
from pathlib import Path

import pytest

from firmware_bridge.autopilots.ardupilot.tilt_parameters import tilt_output, tilt_parameters, yaw_torque_nm
from firmware_bridge.autopilots.ardupilot.vtol_parameters import vtol_parameters
from firmware_bridge.autopilots.installation import Tilt, Vtol
from hil.config import load_bench
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics

RIGS = Path(__file__).parents[4] / "rigs"
ALL, LEFT, RIGHT = 41, 75, 76
FORWARD = (0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def vehicle() -> Vtol:
    settings = ("autopilot.start=false", "vehicle=tiltrotor")
    bench = load_bench(RIGS / "vtol.yaml", rig="ardupilot_sitl", settings=settings)
    found = installation_of(bench, make_physics(bench).state).vehicle
    assert isinstance(found, Vtol)
    return found


def angle_deg(parameters: dict[str, float], n: int, tilt: Tilt, *, told_deg: float) -> float:
    """Return the angle ahead of a hinge for one that ArduPlane wants: output (w + y) / (90 + y) of SERVOn's range."""
    yaw_deg = parameters["Q_TILT_YAW_ANGLE"]
    share = (told_deg + yaw_deg) / (90.0 + yaw_deg)
    if parameters[f"SERVO{n}_REVERSED"]:
        share = 1.0 - share
    low, high = parameters[f"SERVO{n}_MIN"], parameters[f"SERVO{n}_MAX"]
    command = (low + share * (high - low) - 1500.0) / 500.0
    middle, half = 0.5 * (tilt.max_rad + tilt.min_rad), 0.5 * (tilt.max_rad - tilt.min_rad)
    return degrees(middle + half * command) * (1.0 if tilt.ahead_rad > 0.0 else -1.0)


def test_hinges_come_after_the_rotors_and_no_output_is_a_throttle(vehicle: Vtol) -> None:
    """The front rotors, ArduPilot's motors 1 and 3, tilt: the right hinge first, by tiltrotor.yaml."""
    parameters = vtol_parameters(vehicle)
    assert [parameters[f"SERVO{n}_FUNCTION"] for n in range(1, 10)] == [33, 34, 35, 36, RIGHT, LEFT, 77, 78, 0]
    assert (parameters["Q_TILT_ENABLE"], parameters["Q_TILT_MASK"], parameters["Q_TILT_TYPE"]) == (1, 0b0101, 2)


def test_a_hinge_that_ends_upright_leans_ahead_in_hover_to_steer_both_ways(vehicle: Vtol) -> None:
    parameters = vtol_parameters(vehicle)
    for n, tilt in zip((5, 6), vehicle.tilts, strict=True):
        lean_deg = angle_deg(parameters, n, tilt, told_deg=0.0)
        assert lean_deg == pytest.approx(90.0 * 8.0 / 98.0, abs=0.1)
        assert lean_deg < 9.0  # a tenth of the way, with which a transition begins for the verdict
        assert angle_deg(parameters, n, tilt, told_deg=-8.0) == pytest.approx(0.0, abs=0.1)
        assert angle_deg(parameters, n, tilt, told_deg=90.0) == pytest.approx(90.0, abs=0.1)


@pytest.mark.parametrize(("ahead", "axis"), [(1.0, FORWARD), (-1.0, (0.0, -1.0, 0.0))])
def test_a_hinge_that_leans_back_is_upright_in_hover(vehicle: Vtol, ahead: float, axis: tuple[float, ...]) -> None:
    """From 30 degrees back to 90 ahead, of either sense: ArduPlane's angles are the hinge's."""
    ends = sorted((radians(-30.0 * ahead), radians(90.0 * ahead)))
    tilts = [
        replace(
            tilt, axis=axis, min_rad=ends[0], max_rad=ends[1], hover_command=-0.5 * ahead, ahead_command=ahead,
            ahead_rad=radians(90.0 * ahead),
        )
        for tilt in vehicle.tilts
    ]  # fmt: skip
    parameters = tilt_parameters(replace(vehicle, tilts=tilts), [0, 1, 2, 3], 5)
    assert parameters["SERVO5_REVERSED"] == (ahead < 0.0)
    for told_deg in (-8.0, 0.0, 45.0, 90.0):
        assert angle_deg(parameters, 5, tilts[0], told_deg=told_deg) == pytest.approx(told_deg, abs=0.15)


def test_the_yaw_loop_is_as_fast_as_that_of_other_vtols(vehicle: Vtol) -> None:
    """4 /s: half of the weight on the two front rotors, 0.35 m from the middle, and lean them apart by 7.3 degrees."""
    torque = 0.5 * 5.12 * 9.80665 * 0.35 * sin(radians(90.0 * 8.0 / 98.0))
    assert yaw_torque_nm(vehicle) == pytest.approx(torque, rel=1e-3)
    assert vtol_parameters(vehicle)["Q_A_RAT_YAW_P"] * torque / 0.176856 == pytest.approx(4.0, rel=1e-3)


def test_one_hinge_for_both_sides_is_continuous(vehicle: Vtol) -> None:
    both = replace(vehicle.tilts[0], rotors=(0, 2))
    parameters = tilt_parameters(replace(vehicle, tilts=(both,)), [0, 1, 2, 3], 5)
    assert (parameters["Q_TILT_TYPE"], parameters["Q_TILT_MASK"], parameters["SERVO5_FUNCTION"]) == (0, 0b0101, ALL)
    assert yaw_torque_nm(replace(vehicle, tilts=(both,))) is None


def test_a_hinge_with_hover_above_flight_is_reversed() -> None:
    hinge = Tilt(
        "tilt", (0,), (0.0, -1.0, 0.0), -pi / 2, pi / 6, hover_command=0.5, ahead_command=-1.0, ahead_rad=-pi / 2
    )
    ends = {"SERVO5_FUNCTION": 41, "SERVO5_REVERSED": 1, "SERVO5_MIN": 1000, "SERVO5_MAX": 1750, "SERVO5_TRIM": 1000}
    assert tilt_output(5, hinge, ALL) == ends
