"""PX4's parameters for a plane, by its surfaces."""

import math
from pathlib import Path

import pytest

from firmware_bridge.autopilots.installation import Surface
from firmware_bridge.autopilots.mock.wheel_parameters import wheel_parameters
from firmware_bridge.autopilots.px4 import px4_sitl
from firmware_bridge.autopilots.px4.wing_parameters import output_functions, plane_parameters, px4_parameters
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from hil.config import load_bench
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics
from tests.worlds.winged import CONVENTIONAL, plane

RIGS = Path(__file__).parents[4] / "rigs"

# Torques in B (FLU) of trailing edges down: left aileron rolls right, elevator pitches down (+y), rudder yaws left.
ELEVONS = [Surface("elevon_left", (6.0, 2.0, 0.1), 0.0), Surface("elevon_right", (-6.0, 2.0, -0.1), 0.0)]


def test_elevons_share_roll_and_pitch_and_leave_yaw():
    p = plane_parameters(plane(ELEVONS))
    assert (p["CA_AIRFRAME"], p["MAV_TYPE"], p["CA_ROTOR_COUNT"], p["CA_SV_CS_COUNT"]) == (1, 1, 1, 2)
    assert (p["CA_SV_CS0_TYPE"], p["CA_SV_CS1_TYPE"]) == (5, 6)
    assert [p[f"CA_SV_CS0_TRQ_{axis}"] for axis in "RPY"] == [0.5, -0.5, 0.0]
    assert [p[f"CA_SV_CS1_TRQ_{axis}"] for axis in "RPY"] == [-0.5, -0.5, 0.0]
    assert p["FW_YR_P"] == 0.0


def test_ailerons_elevator_and_rudder():
    p = plane_parameters(plane(CONVENTIONAL))
    assert [p[f"CA_SV_CS{i}_TYPE"] for i in range(4)] == [1, 2, 3, 4]
    assert [p[f"CA_SV_CS{i}_TRQ_R"] for i in range(4)] == [0.5, -0.5, 0.0, 0.0]
    assert [p[f"CA_SV_CS{i}_TRQ_P"] for i in range(4)] == [0.0, 0.0, -1.0, 0.0]
    assert [p[f"CA_SV_CS{i}_TRQ_Y"] for i in range(4)] == [0.0, 0.0, 0.0, -1.0]
    assert p["TRIM_PITCH"] == pytest.approx(0.1)  # elevator up by a tenth: nose up
    assert p["FW_YR_P"] > 0.0


def test_the_rate_loop_has_the_bandwidth_of_its_design():
    """Roll: I p' = M (P e + FF p_sp) + L p. Steady at p_sp by FF alone; the pole lies at (M P - L) / I."""
    p = plane_parameters(plane(CONVENTIONAL, damping_nms=(-0.5, -0.1, -1.0)))
    full, inertia, damping = 10.0, 0.3, -0.5
    assert full * p["FW_RR_FF"] == pytest.approx(-damping, rel=1e-3)
    assert (full * p["FW_RR_P"] - damping) / inertia == pytest.approx(7.5, rel=1e-3)


@pytest.mark.parametrize("surfaces", [ELEVONS, CONVENTIONAL])
def test_the_mock_takes_them(surfaces):
    params = [f"{name}={value!r}" for name, value in plane_parameters(plane(surfaces)).items()]
    mock = MockPixhawk(airframe="plane", params=params)
    assert mock.firmware.telemetry.makers
    assert mock.params["CA_SV_CS_COUNT"] == len(surfaces)
    assert "FW_T_CLMB_MAX" not in MockPixhawk().params  # a multirotor has none of them


def test_outputs_have_the_order_of_the_commands():
    assert output_functions(plane(ELEVONS), "PWM_MAIN_FUNC") == {
        "PWM_MAIN_FUNC1": 101, "PWM_MAIN_FUNC2": 201, "PWM_MAIN_FUNC3": 202,
    }  # fmt: skip


def test_sitl_takes_back_what_the_airframe_sets_for_its_own_aircraft():
    """gazebo-classic_plane limits the throttle to 0.6 and uses outputs 3 to 9, the ninth reversed."""
    bench = load_bench(RIGS / "plane.yaml", rig="px4_sitl", settings=["autopilot.start=false"])
    airframe, params = px4_sitl.airframe_and_params(installation_of(bench, make_physics(bench).state))
    assert airframe == "gazebo-classic_plane"
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(1, 17)] == [101, 201, 202] + 13 * [0]
    assert params["PWM_MAIN_REV"] == 0
    assert (params["FW_THR_MIN"], params["FW_THR_MAX"]) == (0.0, 1.0)
    assert params["FW_LND_ABORT"] == 0  # no range finder on board


def test_px4_climbs_off_faster_than_its_slowest_and_leaves_thrust_for_airspeed():
    p = px4_parameters(plane(ELEVONS))
    assert p["FW_TKO_AIRSPD"] == pytest.approx(15.0)  # 1.5 times the stall, above the best glide
    assert px4_parameters(plane(ELEVONS, glide_mps=15.5, cruise_mps=18.0))["FW_TKO_AIRSPD"] == pytest.approx(15.5)
    assert px4_parameters(plane(ELEVONS, cruise_mps=12.0))["FW_TKO_AIRSPD"] == pytest.approx(12.0)  # of cruise at most
    assert p["FW_T_CLMB_MAX"] == pytest.approx(0.6 * 5.0)


def test_px4s_airspeeds_are_calibrated():
    """V_c = V sqrt(rho / rho0); in thin air PX4 multiplies throttle and sink of level flight by sqrt(rho0 / rho)."""
    sea, high = px4_parameters(plane(ELEVONS)), px4_parameters(plane(ELEVONS, density_kgpm3=1.225 * 0.81))
    for name in ("STALL", "MIN", "TRIM", "MAX"):
        assert high[f"FW_AIRSPD_{name}"] == pytest.approx(0.9 * sea[f"FW_AIRSPD_{name}"])
    for name in ("FW_TKO_AIRSPD", "FW_LND_AIRSPD", "FW_THR_TRIM", "FW_T_SINK_MIN"):
        assert high[name] == pytest.approx(0.9 * sea[name])
    dense = px4_parameters(plane(ELEVONS, density_kgpm3=1.225 * 1.21))
    assert dense["FW_THR_TRIM"] == sea["FW_THR_TRIM"]  # the factor is 1 at least


def test_px4_begins_a_corner_early_enough_for_a_wind_from_behind():
    """Half of cruise as wind: the turn at 50 degrees of bank, the drift in a quarter of it, and the roll into it."""
    p = px4_parameters(plane(ELEVONS, cruise_mps=20.0))
    a = 9.80665 * math.tan(math.radians(50.0))
    ahead_m = 400.0 / a + 10.0 * (math.pi / 2) * 20.0 / a + 30.0 * (0.4 + 50.0 / 70.0)
    assert p["NPFG_SW_DST_MLT"] * 30.0 * 7.0 == pytest.approx(ahead_m, rel=1e-3)  # NPFG's bound: speed, period, damping
    assert p["NAV_ACC_RAD"] == pytest.approx(ahead_m, rel=1e-3)


def test_px4_flares_high_enough_to_stop_its_sink():
    p = px4_parameters(plane(ELEVONS))
    sink = 13.0 * math.sin(math.radians(5.0)) + 0.5
    assert p["FW_LND_AIRSPD"] == pytest.approx(1.3 * 10.0)
    assert p["FW_LND_FLALT"] == pytest.approx(sink * (4 / 3 * 0.5 + 0.4) + sink**2 / (0.6 * 9.80665), rel=1e-3)


def test_the_mock_keeps_its_own():
    assert not set(plane_parameters(plane(ELEVONS))) & {
        "NAV_ACC_RAD",
        "NPFG_SW_DST_MLT",
        "FW_LND_FLALT",
        "FW_TKO_AIRSPD",
    }
    assert plane_parameters(plane(ELEVONS, density_kgpm3=1.0))["FW_AIRSPD_TRIM"] == 15.0


def test_a_steered_wheel_is_px4s_landing_gear_wheel_and_the_mocks_surface_without_torque():
    wheels = plane(CONVENTIONAL, wheels=True, ground_pitch_rad=0.2, steering=5, brake=6)
    functions = output_functions(wheels, "PWM_MAIN_FUNC")
    assert functions["PWM_MAIN_FUNC6"] == 440
    assert functions["PWM_MAIN_REV"] == 32  # bit of output 6: PX4 steers to the right at +1, the bench to the left
    assert "PWM_MAIN_FUNC7" not in functions
    assert output_functions(wheels, "HIL_ACT_FUNC")["HIL_ACT_REV"] == 32
    p = plane_parameters(wheels)
    assert (p["RWTO_TKOFF"], p["FW_W_EN"], p["CA_SV_CS_COUNT"]) == (1.0, 1.0, 4)
    assert p["RWTO_PSP"] == pytest.approx(11.46, abs=0.01)
    assert p["RWTO_ROT_AIRSPD"] == pytest.approx(11.5)
    mock = wheel_parameters(wheels)
    assert (mock["CA_SV_CS_COUNT"], mock["CA_SV_CS4_TYPE"], mock["CA_SV_CS5_TYPE"]) == (6, 16, 20)
    assert mock["CA_SV_CS4_TRQ_Y"] == -1.0
    assert wheel_parameters(plane(CONVENTIONAL)) == {}
