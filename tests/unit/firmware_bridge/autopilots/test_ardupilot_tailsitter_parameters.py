"""ArduPlane's parameters for a tailsitter: motors by the frame of the hover, closed forms of throttle and loops."""

from __future__ import annotations

from math import sqrt
from pathlib import Path

import pytest

from firmware_bridge.autopilots.ardupilot import ardupilot_sitl
from firmware_bridge.autopilots.ardupilot.vtol_parameters import vtol_parameters
from firmware_bridge.autopilots.installation import Installation, Vtol
from hil.config import load_bench
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics

RIGS = Path(__file__).parents[4] / "rigs"


@pytest.fixture(scope="module")
def installation() -> Installation:
    settings = ("autopilot.start=false", "vehicle=tailsitter")
    bench = load_bench(RIGS / "vtol.yaml", rig="ardupilot_sitl", settings=settings)
    return installation_of(bench, make_physics(bench).state)


@pytest.fixture(scope="module")
def vehicle(installation: Installation) -> Vtol:
    assert isinstance(installation.vehicle, Vtol)
    return installation.vehicle


def test_its_rotors_are_motors_of_the_hover_frame_and_pull_in_flight(vehicle: Vtol) -> None:
    """By tailsitter.yaml: bottom right, top left, bottom left, top right, and in hover the belly looks ahead."""
    parameters = vtol_parameters(vehicle)
    assert [parameters[f"SERVO{n}_FUNCTION"] for n in range(1, 9)] == [33, 34, 35, 36, 77, 78, 0, 0]
    assert (parameters["Q_ENABLE"], parameters["Q_FRAME_CLASS"], parameters["Q_FRAME_TYPE"]) == (1, 1, 1)
    assert (parameters["Q_TAILSIT_ENABLE"], parameters["Q_TAILSIT_MOTMX"]) == (1, 0b1111)
    assert "Q_TILT_ENABLE" not in parameters


def test_its_cruise_throttle_turns_the_rotors_as_fast_as_in_trim(vehicle: Vtol) -> None:
    """AP_Motors_Thrust_Linearization: e a^2 + (1 - e) a = thrust, the command is SPIN_MIN + (SPIN_MAX - SPIN_MIN) a."""
    parameters = vtol_parameters(vehicle)
    e, thrust = parameters["Q_M_THST_EXPO"], parameters["TRIM_THROTTLE"] / 100.0
    actuator = (e - 1.0 + sqrt((1.0 - e) ** 2 + 4.0 * e * thrust)) / (2.0 * e)
    spin_min, spin_max = parameters["Q_M_SPIN_MIN"], parameters["Q_M_SPIN_MAX"]
    assert spin_min + (spin_max - spin_min) * actuator == pytest.approx(vehicle.wing.throttle, abs=1e-4)


def test_a_wing_across_the_wind_moves_it_less_than_a_metre(vehicle: Vtol) -> None:
    """A flat plate of 0.3 m2 (drag coefficient 1.2) in 5 m/s; the integral of the velocity only helps."""
    parameters = vtol_parameters(vehicle)
    push_mps2 = 0.5 * 1.225 * 5.0**2 * 0.3 * 1.2 / vehicle.hover.mass_kg
    assert push_mps2 / (parameters["Q_P_POSXY_P"] * parameters["Q_P_VELXY_P"]) < 1.0
    # Each loop is at most half as fast as the one in it.
    loops = [parameters[name] for name in ("Q_P_POSXY_P", "Q_P_VELXY_P", "Q_A_ANG_PIT_P")]
    assert all(inner >= 2.0 * outer for outer, inner in zip(loops, [*loops[1:], 15.0], strict=True))


def test_it_turns_its_wing_tip_into_the_wind_before_it_lands(vehicle: Vtol) -> None:
    parameters = vtol_parameters(vehicle)
    assert (parameters["Q_WVANE_ENABLE"], parameters["Q_WVANE_TAKEOFF"]) == (3, 0)


def test_the_bench_gives_it_to_sitl(installation: Installation, tmp_path: Path) -> None:
    command = ardupilot_sitl.start_command(installation, tmp_path)
    assert command.argv[0] == "arduplane"
    assert "Q_TAILSIT_ENABLE 1" in (tmp_path / "bench.parm").read_text()
