"""Parameters of control allocation from a vehicle's rotors: they reproduce a demanded wrench, and tuned airframes."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_bridge import _native
from firmware_bridge.autopilots.mock import mock
from firmware_bridge.autopilots.px4 import px4_sitl
from firmware_bridge.autopilots.px4.rotor_parameters import (
    authority,
    geometry_parameters,
    hover_and_gains,
    matching_airframe,
    mock_parameters,
    px4_parameters,
)
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from hil.config import Bench, load_bench
from hil.config.multirotor_facts import multirotor_facts
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics
from sim.physics import multirotor
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import Vehicle, load_vehicle
from tests.reference.ekf_reference import parameters
from tests.worlds.tilted_rotors import tilted

VEHICLES = [*multirotor_names(), "tilted hexa"]


def vehicle_of(name: str) -> Vehicle:
    return tilted(load_vehicle("hexa_x"), 15.0) if name == "tilted hexa" else load_vehicle(name)


def mock_airframe(bench: Bench) -> tuple[str, list[str]]:
    return mock.airframe_and_params(installation_of(bench, make_physics(bench).state))


def px4_airframe(bench: Bench) -> tuple[str, dict[str, float]]:
    return px4_sitl.airframe_and_params(installation_of(bench, make_physics(bench).state))


@pytest.mark.parametrize("name", VEHICLES)
def test_allocation_reproduces_a_demanded_wrench(name: str) -> None:
    """Demands within the limits come out of the vehicle's own rotors, in B (FLU), as fractions of the authority."""
    vehicle = vehicle_of(name)
    c, full = vehicle.rotor_constants, authority(multirotor_facts(vehicle))
    native = geometry_parameters(multirotor_facts(vehicle)) | {
        "THR_MDL_FAC": c.thrust_model_factor,
        "MOT_SPIN_IDLE": 0.0,
    }
    params = parameters(**native)
    strongest_n = c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2
    random = np.random.default_rng(7)
    for _ in range(20):
        roll, pitch, yaw = random.uniform(-0.05, 0.05, 3)
        thrust = random.uniform(0.4, 0.6)
        commands, tilt, turn = _native.allocate(params, roll, pitch, yaw, thrust)
        assert (tilt, turn) == (1.0, 1.0)
        u = np.array(commands)
        share = c.thrust_model_factor * u**2 + (1.0 - c.thrust_model_factor) * u
        _, _, lift_n, *torque_nm = multirotor.effectiveness(vehicle) @ (share * strongest_n)
        demand = [roll * full.roll_nm, -pitch * full.pitch_nm, -yaw * full.yaw_nm]
        assert torque_nm == pytest.approx(demand, abs=2e-5 * full.roll_nm)
        assert lift_n == pytest.approx(thrust * full.thrust_n, rel=1e-5)


@pytest.mark.parametrize("name", VEHICLES)
def test_hover_thrust_is_the_weight(name: str) -> None:
    vehicle = vehicle_of(name)
    thrust_n = (
        hover_and_gains(multirotor_facts(vehicle))["MPC_THR_HOVER"] * authority(multirotor_facts(vehicle)).thrust_n
    )
    assert thrust_n == pytest.approx(vehicle.mass_kg * 9.80665, rel=1e-3)


def test_gains_are_about_those_that_the_x500_was_tuned_to() -> None:
    found = hover_and_gains(multirotor_facts(load_vehicle("x500")))
    defaults = dict(zip(_native.PARAM_NAMES, _native.PARAM_DEFAULTS, strict=True))
    assert found == pytest.approx({name: defaults[name] for name in found}, rel=0.01)


def test_airframes_are_known_by_their_rotors() -> None:
    known = {name: matching_airframe(multirotor_facts(load_vehicle(name))) for name in multirotor_names()}
    assert known == dict.fromkeys(multirotor_names()) | {"x500": "x500", "iris": "iris"}


@pytest.mark.parametrize("name", multirotor_names())
def test_the_mock_takes_its_parameters(name: str) -> None:
    vehicle = load_vehicle(name)
    mock = MockPixhawk(params=[f"{key}={value!r}" for key, value in mock_parameters(multirotor_facts(vehicle)).items()])
    assert mock.firmware.rotors == len(vehicle.rotors)
    assert mock.params["CA_ROTOR2_PY"] == pytest.approx(-vehicle.rotors[2].position_m[1], abs=1e-6)


def test_the_bench_decides_over_the_vehicle() -> None:
    assert mock_airframe(load_bench()) == ("x500", [])
    assert mock_airframe(load_bench(settings=["vehicle=iris"]))[0] == "iris"
    assert mock_airframe(load_bench(settings=["vehicle=iris", "autopilot.airframe=x500"])) == ("x500", [])
    airframe, params = mock_airframe(load_bench(settings=["vehicle=y6", "autopilot.params.MC_ROLL_P=3"]))
    assert airframe == "x500"
    assert {"CA_ROTOR_COUNT=6", "MAV_TYPE=13", "MC_ROLL_P=3.0"} <= set(params)


def test_px4_gets_the_rotors_unless_it_has_them() -> None:
    start = ["autopilot.start=false"]
    iris = load_bench(rig="px4_sitl", settings=start)
    gps = [f"SENS_{kind}_DELAY" for kind in ("GPS0", "GPS1", "GNSS0", "GNSS1")]
    of_sensors = dict.fromkeys(("EKF2_GPS_DELAY", *gps), 100.0) | {"EKF2_BARO_DELAY": 0.0, "EKF2_MAG_DELAY": 0.0}
    assert px4_airframe(iris) == ("none_iris", of_sensors)
    octa = load_bench(rig="px4_sitl", settings=[*start, "vehicle=octa_x"])
    airframe, params = px4_airframe(octa)
    assert airframe == "none_iris"
    assert [params[f"PWM_MAIN_FUNC{n}"] for n in range(1, 9)] == list(range(101, 109))
    assert (params["CA_ROTOR_COUNT"], params["MAV_TYPE"]) == (8, 14)
    assert params["CA_ROTOR0_PX"] > 0.0 > params["CA_ROTOR0_KM"]  # front right, clockwise
    own = load_bench(rig="px4_sitl", settings=[*start, "vehicle=octa_x", "autopilot.airframe=8001"])
    assert px4_airframe(own) == ("8001", of_sensors)
    assert px4_parameters(multirotor_facts(load_vehicle("y6")), outputs="HIL_ACT_FUNC")["HIL_ACT_FUNC6"] == 106
