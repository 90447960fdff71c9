"""ArduPlane's parameters for a plane: its outputs by the signs of the torques, and its gains in ArduPlane's own law."""

from __future__ import annotations

from math import degrees, pi
from pathlib import Path

import pytest

from firmware_bridge.autopilots.ardupilot import ardupilot_sitl
from firmware_bridge.autopilots.ardupilot.vtol_parameters import vtol_parameters
from firmware_bridge.autopilots.ardupilot.wing_parameters import plane_parameters
from firmware_bridge.autopilots.installation import Surface, Vtol
from firmware_bridge.autopilots.px4.wing_parameters import full_torques_nm, rate_gains
from firmware_bridge.links.ardupilot.sitl import PLANE_DEFAULTS_PATH
from hil.config import load_bench
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics
from tests.worlds.winged import CONVENTIONAL, PUSHER, plane

VTOL = ("autopilot.start=false", "vehicle=quadplane", "mission=null", "start={}")
RIGS = Path(__file__).parents[4] / "rigs"
# Torques in B (FLU) of trailing edges down: a left aileron rolls to the right, an elevator pitches down (+y), a rudder
# whose trailing edge goes to the left yaws to the left (+z).
ELEVONS = [Surface("elevon_left", (6.0, 2.0, 0.1), -0.1), Surface("elevon_right", (-6.0, 2.0, -0.1), -0.1)]
V_TAIL = [
    Surface("aileron", (10.0, 0.0, 0.1), 0.0),
    Surface("tail_left", (0.0, 4.0, -2.0), 0.0),
    Surface("tail_right", (0.0, 4.0, 2.0), 0.0),
]
FLAP = Surface("flap", (0.0, 0.0, 0.0), 0.0)


def mixed(parameters: dict[str, float], roll: float, pitch: float, yaw: float, n: int) -> float:
    """Return the command (-1..1) of output `n` by SRV_Channel's mixers, for demands to the right, up and right."""
    gain = 1.0
    value = {
        4: roll, 19: pitch, 21: yaw, 0: 0.0, 77: gain * (pitch - roll), 78: gain * (pitch + roll),
        79: gain * (pitch + yaw), 80: gain * (pitch - yaw),
    }[int(parameters[f"SERVO{n}_FUNCTION"])]  # fmt: skip
    return -value if parameters[f"SERVO{n}_REVERSED"] else value


@pytest.mark.parametrize("surfaces", [ELEVONS, CONVENTIONAL, V_TAIL, [*CONVENTIONAL, FLAP]])
def test_a_full_demand_of_an_axis_turns_the_plane_that_way_with_all_that_serve_it(surfaces: list[Surface]) -> None:
    vehicle = plane(surfaces)
    parameters = plane_parameters(vehicle)
    for axis, demand in enumerate([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]):
        full = full_torques_nm(vehicle)[axis]
        sign = (1.0, -1.0, -1.0)[axis]  # FLU to FRD
        made = sum(
            mixed(parameters, *demand, 2 + i) * sign * surface.torque_nm[axis] for i, surface in enumerate(surfaces)
        )
        assert made == pytest.approx(full, rel=0.02)


def test_outputs_have_the_order_of_the_commands_and_rest_at_the_trim() -> None:
    parameters = plane_parameters(plane(ELEVONS))
    assert [parameters[f"SERVO{n}_FUNCTION"] for n in range(1, 17)] == [70, 77, 78] + 13 * [0]
    assert [parameters[f"SERVO{n}_TRIM"] for n in (1, 2, 3)] == [1000, 1450, 1450]
    assert {parameters[f"SERVO{n}_{end}"] for n in (1, 2, 3) for end in ("MIN", "MAX")} == {1000, 2000}
    twin = plane_parameters(plane([*CONVENTIONAL, FLAP], rotors=[PUSHER, PUSHER]))
    assert [twin[f"SERVO{n}_FUNCTION"] for n in range(1, 9)] == [70, 70, 4, 4, 19, 21, 0, 0]


def test_the_rate_loops_are_those_of_the_vehicle_in_arduplanes_law() -> None:
    """At SCALING_SPEED its output is (180 / pi) (FF r + P e) degrees, of 45 for a full demand."""
    vehicle = plane(CONVENTIONAL)
    ours, parameters = rate_gains(vehicle), plane_parameters(vehicle)
    assert parameters["SCALING_SPEED"] == 15.0
    for name, of_px4 in (("RLL", "RR"), ("PTCH", "PR")):
        for part in ("P", "I", "FF"):
            share = (180.0 / pi) * parameters[f"{name}_RATE_{part}"] / 45.0
            assert share == pytest.approx(ours[f"FW_{of_px4}_{part}"], rel=1e-3)
    # Its yaw damper takes degrees per second: out [deg] = YAW2SRV_DAMP rate.
    assert parameters["YAW2SRV_DAMP"] * degrees(1.0) / 45.0 == pytest.approx(ours["FW_YR_P"], rel=1e-3)


def test_airspeeds_and_turns() -> None:
    parameters = plane_parameters(plane(ELEVONS))
    assert (parameters["AIRSPEED_MIN"], parameters["AIRSPEED_CRUISE"]) == (12.0, 15.0)
    assert parameters["TRIM_ARSPD_CM"] == 1500.0  # before 4.5
    # A right angle of a radius of 32.8 m (35 degrees of bank) begins at the L1 distance, 1.35 times as far.
    distance = 0.3183 * parameters["NAVL1_DAMPING"] * parameters["NAVL1_PERIOD"] * 15.0
    assert distance == pytest.approx(1.35 * 15.0**2 / (9.80665 * 0.70021), rel=1e-3)
    assert parameters["WP_RADIUS"] > distance


def test_a_bench_with_a_plane_gives_them_to_sitl(tmp_path: Path) -> None:
    bench = load_bench(RIGS / "plane.yaml", rig="ardupilot_sitl", settings=["autopilot.start=false"])
    command = ardupilot_sitl.start_command(installation_of(bench, make_physics(bench).state), tmp_path)
    assert command.argv[0] == "arduplane"
    text = (tmp_path / "bench.parm").read_text()
    assert text.startswith(PLANE_DEFAULTS_PATH.read_text())
    read = {name: float(value) for name, value in (line.split() for line in text.splitlines() if line[:1].isalpha())}
    assert (read["SERVO1_FUNCTION"], read["SERVO2_FUNCTION"], read["SERVO3_FUNCTION"]) == (70, 77, 78)
    assert (read["ARSPD_TYPE"], read["ARSPD_USE"]) == (100, 1)  # the bench has a pitot tube
    assert (read["SIM_RATE_HZ"], read["SCHED_LOOP_RATE"]) == (400, 200)
    assert "FRAME_CLASS" not in read


def test_a_quadplane_has_its_lifters_as_motors_and_its_pusher_as_throttle(tmp_path: Path) -> None:
    """Lifters front right, rear left, front left, rear right, then the pusher and the elevons, by quadplane.yaml."""
    bench = load_bench(RIGS / "plane.yaml", rig="ardupilot_sitl", settings=VTOL)
    installation = installation_of(bench, make_physics(bench).state)
    vehicle = installation.vehicle
    assert isinstance(vehicle, Vtol)
    parameters = vtol_parameters(vehicle)
    assert [parameters[f"SERVO{n}_FUNCTION"] for n in range(1, 9)] == [33, 34, 35, 36, 70, 77, 78, 0]
    assert (parameters["Q_ENABLE"], parameters["Q_FRAME_CLASS"], parameters["Q_FRAME_TYPE"]) == (1, 1, 1)
    assert vehicle.wing.stall_mps < parameters["Q_ASSIST_SPEED"] < parameters["AIRSPEED_MIN"]
    # Roll by half of each lifter's range: 4 x 45 N x 0.35 m / 2 at full speed, 0.88 of it between the ends of the spin.
    torque = 0.5 * 4 * 2.0e-5 * 1500.0**2 * 0.35 * (0.95**2 - 0.15**2)
    assert parameters["Q_A_RAT_RLL_P"] * torque / 0.480256 == pytest.approx(15.0, rel=0.06)  # thin air at the site
    # Back to hover: the nose rises within the time to stop from where the lifters take over, 1.15 times the stall.
    assert parameters["Q_ASSIST_SPEED"] / vehicle.wing.stall_mps == pytest.approx(1.15, rel=1e-4)
    stop_s = parameters["Q_ASSIST_SPEED"] / parameters["Q_TRANS_DECEL"]
    assert parameters["Q_BACKTRANS_MS"] == pytest.approx(1000.0 * stop_s, rel=1e-3)
    # Of the approach a second of braking leaves 1.2 times the stall.
    assert parameters["TECS_LAND_ARSPD"] - parameters["Q_TRANS_DECEL"] == pytest.approx(parameters["AIRSPEED_MIN"])
    assert parameters["Q_P_POSXY_P"] < parameters["Q_P_VELXY_P"] < 15.0 / 3.0
    ardupilot_sitl.start_command(installation, tmp_path)
    assert "Q_M_THST_HOVER" in (tmp_path / "bench.parm").read_text()
