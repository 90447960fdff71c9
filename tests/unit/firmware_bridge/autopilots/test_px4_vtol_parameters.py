"""PX4's parameters for a standard VTOL and a tiltrotor, by the airframe that they replace."""

import dataclasses
import math
from pathlib import Path

import pytest

from firmware_bridge.autopilots.px4 import px4_sitl
from firmware_bridge.autopilots.px4.rotor_parameters import hover_and_gains
from firmware_bridge.autopilots.px4.vehicle_parameters import vehicle_parameters
from firmware_bridge.autopilots.px4.vtol_parameters import (
    px4_vtol_parameters,
    tilt_parameters,
    tilt_problem,
    vtol_parameters,
)
from firmware_bridge.autopilots.px4.wing_parameters import calibration
from hil.config import load_bench
from hil.config.airframe_facts import vtol_facts
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics

PLANE_MODULES = ["px4-fw_att_control", "px4-fw_rate_control", "px4-fw_mode_manager", "px4-airspeed_selector"]
RIGS = Path(__file__).parents[4] / "rigs"


@pytest.fixture(scope="module")
def bench():
    return load_bench(RIGS / "vtol.yaml", rig="px4_sitl", settings=["autopilot.start=false"])


@pytest.fixture(scope="module")
def facts(bench):
    return vtol_facts(bench.vehicle, bench.scene.site)


def test_outputs_are_lifters_pusher_and_surfaces_in_the_order_of_the_commands(bench):
    airframe, params = px4_sitl.airframe_and_params(installation_of(bench, make_physics(bench).state))
    assert airframe == "gazebo-classic_standard_vtol"
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(1, 17)] == [101, 102, 103, 104, 105, 201, 202] + 9 * [0]
    assert (params["CA_AIRFRAME"], params["VT_TYPE"], params["MAV_TYPE"]) == (2, 2, 22)
    assert [params[f"CA_ROTOR{n}_AX"] for n in range(5)] == [0, 0, 0, 0, 1]
    assert [params[f"CA_ROTOR{n}_AZ"] for n in range(5)] == [-1, -1, -1, -1, 0]


def test_what_the_airframe_sets_for_its_own_aircraft_is_taken_back(bench):
    _, params = px4_sitl.airframe_and_params(installation_of(bench, make_physics(bench).state))
    assert (params["FW_THR_MAX"], params["FW_THR_ASPD_MAX"], params["NPFG_PERIOD"]) == (1.0, 0.0, 10.0)
    assert (params["VT_F_TRANS_THR"], params["VT_FWD_THRUST_EN"]) == (1.0, 0.0)
    assert "SYS_AUTOSTART" not in params  # PX4's start script has it from the environment


@pytest.mark.parametrize(
    ("modules", "lacking"),
    [
        (["px4-commander"], "fw_att_control, fw_rate_control, fw_mode_manager, airspeed_selector, vtol_att_control"),
        (PLANE_MODULES, "vtol_att_control"),
        ([*PLANE_MODULES, "px4-vtol_att_control"], None),
        ([], None),  # not a build tree: nothing is known
    ],
)
def test_a_build_without_the_controllers_of_a_vtol_is_refused(bench, facts, tmp_path, modules, lacking):
    for name in modules:
        (tmp_path / name).write_text("")
    settings = bench.config.autopilot.model_copy(update={"binary": str(tmp_path / "px4")})
    found = px4_sitl.vehicle_misfits(settings, facts)
    assert [misfit.place for misfit in found] == ([("autopilot", "binary")] if lacking else [])
    if lacking:
        assert found[0].message == f"this PX4 cannot fly 'quadplane': it was built without {lacking}"


def test_more_surfaces_than_px4_has_are_refused(bench, facts):
    wing = dataclasses.replace(facts.wing, surfaces=[facts.wing.surfaces[0]] * 9)
    (found,) = px4_sitl.vehicle_misfits(bench.config.autopilot, dataclasses.replace(facts, wing=wing))
    assert "has 9 control surfaces, and PX4 takes 8" in found.message


def test_the_throttles_of_the_wings_are_shares_of_the_thrust(facts):
    """PX4 turns a share into a command by THR_MDL_FAC f, of which f u^2 + (1 - f) u is the share; here f is 1."""
    px4, calibration = px4_vtol_parameters(facts), (facts.wing.density_kgpm3 / 1.225) ** 0.5
    assert px4["THR_MDL_FAC"] == 1.0
    assert px4["FW_THR_TRIM"] == pytest.approx((facts.wing.throttle * calibration) ** 2, rel=1e-3)


def test_the_airspeeds_of_a_transition_are_calibrated(facts):
    own, px4 = vtol_parameters(facts), px4_vtol_parameters(facts)
    calibration = (facts.wing.density_kgpm3 / 1.225) ** 0.5
    assert calibration < 0.98
    for name in ("VT_ARSP_TRANS", "VT_ARSP_BLEND", "FW_AIRSPD_TRIM"):
        assert px4[name] == pytest.approx(own[name] * calibration, rel=1e-3)
    assert px4["VT_ARSP_BLEND"] == pytest.approx(px4["FW_AIRSPD_STALL"], rel=1e-3)
    assert px4["VT_ARSP_BLEND"] < px4["VT_ARSP_TRANS"] <= px4["FW_AIRSPD_TRIM"]


@pytest.fixture(scope="module")
def tiltrotor():
    bench = load_bench(RIGS / "vtol.yaml", rig="px4_sitl", settings=["autopilot.start=false", "vehicle=tiltrotor"])
    return vtol_facts(bench.vehicle, bench.scene.site)


def test_a_tiltrotor_has_its_tilts_between_motors_and_surfaces(tiltrotor):
    params = vehicle_parameters(tiltrotor)
    assert (params["CA_AIRFRAME"], params["VT_TYPE"], params["MAV_TYPE"]) == (3, 1, 21)
    # PX4 numbers the servos of the surfaces, 201 and 202, before those of the tilts.
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(1, 9)] == [101, 102, 103, 104, 203, 204, 201, 202]
    assert [params.get(f"CA_ROTOR{n}_TILT") for n in range(4)] == [1, None, 2, None]
    assert params["CA_SV_TL_COUNT"] == 2
    for n in range(2):
        assert [params[f"CA_SV_TL{n}_{key}"] for key in ("CT", "TD", "MINA", "MAXA")] == [1, 0, 0, 90]
    assert [params[f"VT_TILT_{key}"] for key in ("MC", "TRANS", "FW")] == [0.0, 0.6, 1.0]


def test_the_yaw_of_a_tiltrotor_is_that_of_one_tilt_ahead(tiltrotor):
    """One front rotor with a quarter of the weight, 0.35 m aside, turned by 45 degrees per unit of command."""
    full_nm = 5.12 * 9.80665 / 4 * 0.35 * math.radians(45)
    assert vehicle_parameters(tiltrotor)["MC_YAWRATE_P"] == pytest.approx(5.0 * 0.176856 / full_nm, rel=1e-3)


def test_the_time_of_a_transition_with_tilts(tiltrotor):
    """Half of the lifters at 54 degrees pull with g / 2 sin 54; on the way there, 5 s, with half of that on average."""
    params = vtol_parameters(tiltrotor)
    waiting_mps2 = 0.5 * 9.80665 * math.sin(math.radians(54))
    for name, airspeed, times in (("VT_F_TR_OL_TM", "VT_ARSP_BLEND", 2), ("VT_TRANS_TIMEOUT", "VT_ARSP_TRANS", 3)):
        least_s = 2.5 + params[airspeed] / waiting_mps2
        assert params[name] == pytest.approx(times * least_s, rel=1e-3)


def test_the_elevators_of_a_tiltrotor_are_twice_as_fast(tiltrotor):
    """A loop of 15 1/s about the damped pitch: M P = 15 I + L."""
    wing = tiltrotor.wing
    torque_nm = sum(abs(surface.torque_nm[1]) for surface in wing.surfaces)
    gain = vehicle_parameters(tiltrotor)["FW_PR_P"]
    assert gain * torque_nm == pytest.approx(15.0 * 0.160447 + wing.damping_nms[1], rel=1e-3)
    assert gain > 2.0 * vehicle_parameters(tiltrotor.wing)["FW_PR_P"]


def test_the_pitch_of_a_tiltrotor_on_its_wings_is_stiff(tiltrotor):
    params = vehicle_parameters(tiltrotor)
    assert (params["FW_P_TC"], params["FW_P_RMAX_POS"]) == (0.2, 120.0)
    assert "FW_P_TC" not in vehicle_parameters(tiltrotor.wing)


def test_the_thrusts_of_a_tiltrotor_are_commands(tiltrotor):
    """So are those of hover and cruise. The gains give the same torque per angular rate about hover, where T is u^2."""
    params, shares = vehicle_parameters(tiltrotor), hover_and_gains(tiltrotor.hover)
    u = tiltrotor.hover.hover_control
    assert shares["THR_MDL_FAC"] == 1.0
    assert params["THR_MDL_FAC"] == 0.0
    assert params["MPC_THR_HOVER"] == pytest.approx(u)
    assert params["MPC_THR_MIN"] ** 2 == pytest.approx(
        0.24 * u**2, rel=1e-4
    )  # the thrust, as PX4's 0.12 with a hover of 0.5
    assert params["FW_THR_TRIM"] == pytest.approx(tiltrotor.wing.throttle * calibration(tiltrotor.wing), rel=1e-3)
    slope = ((u + 1e-6) ** 2 - u**2) / 1e-6
    for name in ("MC_ROLLRATE_P", "MC_PITCHRATE_I", "MC_PITCHRATE_D"):
        assert params[name] * slope == pytest.approx(shares[name], rel=1e-4)
    assert params["MC_ROLL_P"] == shares["MC_ROLL_P"]


def test_a_tilt_in_the_middle_does_not_steer(tiltrotor):
    middle = [dataclasses.replace(rotor, position_m=(0.3, 0.0, 0.0)) for rotor in tiltrotor.hover.rotors]
    facts = dataclasses.replace(tiltrotor, hover=dataclasses.replace(tiltrotor.hover, rotors=middle))
    values = tilt_parameters(facts)
    assert (values["CA_SV_TL0_CT"], values["CA_SV_TL1_CT"]) == (0, 0)
    assert "MC_YAWRATE_P" not in values


def test_a_hinge_to_the_right_has_the_same_angles_to_the_front(tiltrotor):
    reversed_axis = [
        dataclasses.replace(tilt, axis=(0.0, -1.0, 0.0), min_rad=0.0, max_rad=-tilt.max_rad, ahead_rad=-tilt.ahead_rad)
        for tilt in tiltrotor.tilts
    ]
    facts = dataclasses.replace(tiltrotor, tilts=reversed_axis)
    assert tilt_problem(facts) is None
    assert tilt_parameters(facts) == tilt_parameters(tiltrotor)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"hover_command": 1.0, "ahead_command": -1.0}, "'tilt_left' turns with a falling one"),
        ({"hover_command": -0.5}, "'tilt_right' and 'tilt_left' have other ranges"),
    ],
)
def test_tilts_that_px4_cannot_turn_together_are_refused(bench, tiltrotor, change, told):
    right, left = tiltrotor.tilts
    facts = dataclasses.replace(tiltrotor, tilts=[right, dataclasses.replace(left, **change)])
    (found,) = px4_sitl.vehicle_misfits(bench.config.autopilot, facts)
    assert told in found.message


def test_more_tilts_than_px4_has_are_refused(bench, tiltrotor):
    facts = dataclasses.replace(tiltrotor, tilts=[tiltrotor.tilts[0]] * 5)
    (found,) = px4_sitl.vehicle_misfits(bench.config.autopilot, facts)
    assert "has 5 tilts, and PX4 takes 4" in found.message
