"""PX4's parameters for a tailsitter: its frames, its change of attitude, its hover in wind."""

import math
from pathlib import Path

import numpy as np
import pytest

from firmware_bridge.autopilots.px4 import px4_sitl
from firmware_bridge.autopilots.px4.vehicle_parameters import vehicle_parameters
from firmware_bridge.autopilots.px4.wing_parameters import calibration, torques_frd_nm
from hil.config import load_bench
from hil.config.airframe_facts import vtol_facts
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics
from signals.units import STANDARD_GRAVITY_MPS2

RIGS = Path(__file__).parents[4] / "rigs"
# ROTATION_PITCH_90 of PX4's lib/conversion/rotation.h: what the board feels, in PX4's body.
PITCH_90 = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def bench():
    return load_bench(RIGS / "vtol.yaml", rig="px4_sitl", settings=["autopilot.start=false", "vehicle=tailsitter"])


@pytest.fixture(scope="module")
def facts(bench):
    return vtol_facts(bench.vehicle, bench.scene.site)


@pytest.fixture(scope="module")
def params(facts):
    return vehicle_parameters(facts)


def test_it_is_flown_by_px4_as_its_tailsitter(bench, facts, params):
    assert px4_sitl.vehicle_misfits(bench.config.autopilot, facts) == []
    assert (params["CA_AIRFRAME"], params["VT_TYPE"], params["MAV_TYPE"]) == (4, 0, 23)
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(1, 7)] == [101, 102, 103, 104, 201, 202]


def test_the_board_feels_the_weight_downwards_where_it_stands_and_a_lowered_nose_as_pitch_down(params):
    assert params["SENS_BOARD_ROT"] == 24
    g = STANDARD_GRAVITY_MPS2
    np.testing.assert_allclose(PITCH_90 @ (g, 0.0, 0.0), (0.0, 0.0, -g))  # specific force on its tail, x to the nose
    np.testing.assert_allclose(PITCH_90 @ (0.0, -0.5, 0.0), (0.0, -0.5, 0.0))
    np.testing.assert_allclose(PITCH_90 @ (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))  # out of the belly is ahead in hover


def test_surfaces_turn_with_the_board(facts, params):
    """Torque over the sum of all about an axis, as on the wings, in the frame of hover."""
    full = [sum(abs(torques_frd_nm(s)[axis]) for s in facts.wing.surfaces) for axis in range(3)]
    for n, surface in enumerate(facts.wing.surfaces):
        roll, pitch, _ = (torque / most for torque, most in zip(torques_frd_nm(surface), full, strict=True))
        turned = PITCH_90 @ (roll, pitch, 0.0)  # elevons do not serve the yaw
        found = [params[f"CA_SV_CS{n}_TRQ_{letter}"] for letter in "RPY"]
        np.testing.assert_allclose(found, turned, atol=1e-4)


def test_rotors_have_the_places_and_spins_of_px4s_own_tailsitter(params):
    """Airframe 1041, gazebo-classic_tailsitter: its places are +-1."""
    own = [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]
    for n, signs in enumerate(own):
        found = [params[f"CA_ROTOR{n}_{key}"] for key in ("PX", "PY", "KM")]
        assert np.sign(found).tolist() == list(signs)
        assert [params[f"CA_ROTOR{n}_A{axis}"] for axis in "XYZ"] == [0, 0, -1]


def test_the_nose_is_lowered_while_the_thrust_of_hover_leads_to_the_airspeed_of_the_transition(facts, params):
    """Integrated in steps, from upright to 30 degrees over the horizon."""
    turning_s = params["VT_F_TRANS_DUR"]
    t = (np.arange(10_000) + 0.5) / 10_000 * turning_s * 2 / 3
    v_mps = float(np.mean(STANDARD_GRAVITY_MPS2 * np.sin(0.5 * math.pi * t / turning_s)) * turning_s * 2 / 3)
    assert v_mps * calibration(facts.wing) == pytest.approx(params["VT_ARSP_TRANS"], rel=1e-3)
    assert params["VT_B_TRANS_DUR"] == turning_s
    assert params["VT_B_DEC_MSS"] * turning_s == pytest.approx(facts.wing.cruise_mps, rel=1e-3)
    assert params["VT_F_TR_OL_TM"] == pytest.approx(2 * turning_s, rel=1e-3)
    assert params["VT_TRANS_TIMEOUT"] == pytest.approx(3 * turning_s, rel=1e-3)


def test_the_least_thrust_is_the_same_share_of_hover_as_px4s(params):
    assert params["MPC_THR_MIN"] / params["MPC_THR_HOVER"] == pytest.approx(0.12 / 0.5)
    assert params["MPC_XY_VEL_I_ACC"] == pytest.approx(0.8 * params["MPC_XY_VEL_P_ACC"])
    assert (params["MC_AIRMODE"], params["WV_EN"], params["EKF2_FUSE_BETA"]) == (0, 0, 0)


def test_outputs_of_the_airframes_own_aircraft_are_off(bench):
    airframe, params = px4_sitl.airframe_and_params(installation_of(bench, make_physics(bench).state))
    assert airframe == "gazebo-classic_standard_vtol"
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(7, 17)] == [0] * 10
