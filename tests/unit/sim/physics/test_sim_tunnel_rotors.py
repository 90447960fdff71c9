"""Rotors by wind-tunnel coefficients: the measured points, standing rotors, descent, density, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import pydantic
import pytest

from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.forces.wind_tunnel import WindTunnel
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.motors import SLOW_FLYER, with_tunnel

TICK_NS = 1_000
STILL = Effects(ground_effect=False, air_density=False)

# J, C_T, C_P of APC Slow Flyer 10 x 4.7 in, UIUC propeller database, volume 1: static at 6528 rev/min, and the runs at
# 6512 and 6020 rev/min.
UIUC = (
    (0.0, 0.1299, 0.0531),
    (0.089, 0.1201, 0.0523),
    (0.199, 0.1019, 0.0493),
    (0.308, 0.0833, 0.0454),
    (0.395, 0.0669, 0.0414),
    (0.480, 0.0471, 0.0351),
    (0.574, 0.0235, 0.0279),
    (0.652, 0.0017, 0.0207),
    (0.719, -0.0178, 0.0141),
    (0.774, -0.0347, 0.0085),
)


def bare(**changes: Any) -> Vehicle:
    """Return the x500 with these rotors, all turning the same way, and without drag of the airframe."""
    data = with_tunnel("x500").model_dump()
    data["body_drag_quadratic_n_per_m2ps2"] = (0.0, 0.0, 0.0)
    data["rotor_constants"] |= {"drag_kg_per_rad": 0.0}
    for rotor in data["rotors"]:
        rotor["spin"] = "ccw"
    return Vehicle.model_validate(data | changes)


def thrust_and_torque(
    vehicle: Vehicle, speed: float, climb_mps: float, *, effects: Effects = STILL
) -> tuple[float, float]:
    """Return the thrust of a rotor and its torque, from the accelerations over a microsecond."""
    physics = VehiclePhysics(
        vehicle, load_scene("airfield"), TICK_NS, effects=effects, start=FlightStart(p_WB=(0.0, 0.0, 1000.0))
    )
    physics.state[13:] = speed
    physics.state[9] = climb_mps
    physics.advance(0, (0.0,) * 4)
    truth = physics.advance(1, (speed / vehicle.rotor_constants.max_speed_radps,) * 4)
    return vehicle.mass_kg * (truth.a_WB_W[2] + 9.80665) / 4.0, -vehicle.inertia_kgm2[2] * truth.alpha_WB_B[2] / 4.0


@pytest.mark.parametrize(("advance", "thrust", "power"), UIUC)
def test_measured_points(advance: float, thrust: float, power: float) -> None:
    """Within 1.5 % of the static coefficients, which are those of the file."""
    vehicle, speed = bare(), 700.0
    c = vehicle.rotor_constants
    flow = advance * speed * c.radius_m / math.pi
    t, q = thrust_and_torque(vehicle, speed, flow)
    static = c.thrust_coefficient_n_per_radps2 * speed * speed
    assert t / static == pytest.approx(thrust / 0.1299, abs=0.016)
    assert q / (c.moment_ratio_m * static) == pytest.approx(power / 0.0531, abs=0.016)


def test_static_thrust_and_torque_are_those_of_the_file() -> None:
    vehicle = bare()
    c = vehicle.rotor_constants
    t, q = thrust_and_torque(vehicle, 700.0, 0.0)
    assert t == pytest.approx(c.thrust_coefficient_n_per_radps2 * 700.0**2, rel=1e-5)
    assert q == pytest.approx(c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * 700.0**2, rel=1e-5)


def test_a_standing_rotor_and_reverse_flow() -> None:
    """A disc in the flow: thrust against it both ways, growing with its square; descent adds thrust."""
    vehicle = bare()
    up, down = (thrust_and_torque(vehicle, 0.0, climb)[0] for climb in (10.0, -10.0))
    assert up == pytest.approx(-down, rel=1e-4)
    assert thrust_and_torque(vehicle, 0.0, 20.0)[0] == pytest.approx(4.0 * up, rel=1e-4)
    a = SLOW_FLYER["thrust_coefficients"]
    c = vehicle.rotor_constants
    bend = c.thrust_coefficient_n_per_radps2 * a[2] / a[0] * (math.pi / c.radius_m) ** 2
    assert up == pytest.approx(bend * 100.0, rel=1e-4)
    thrusts = [thrust_and_torque(vehicle, 700.0, -sink)[0] for sink in (0.0, 2.0, 5.0, 10.0)]
    assert thrusts == sorted(thrusts)
    assert thrust_and_torque(vehicle, 200.0, -15.0)[1] < 0.0  # autorotation


def test_thrust_and_torque_follow_the_density() -> None:
    vehicle = bare()
    thin, there = (thrust_and_torque(vehicle, 700.0, 3.0, effects=e) for e in (Effects(ground_effect=False), STILL))
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 1000.0)))
    ratio = physics.density_ratio
    assert 0.8 < ratio < 0.9
    assert thin[0] == pytest.approx(ratio * there[0], rel=1e-5)
    assert thin[1] == pytest.approx(ratio * there[1], rel=1e-5)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"thrust_coefficients": (0.1, 0.2, -0.1)}, "less than or equal to 0"),
        ({"thrust_coefficients": (0.1, 0.0, 0.0)}, "the thrust must fall with the advance ratio"),
        ({"thrust_coefficients": (0.0, -0.1, -0.1)}, "greater than 0"),
        ({"power_coefficients": (0.05, 0.0, 0.1)}, "less than or equal to 0"),
        ({"power_coefficients": (0.05, 0.0)}, "power_coefficients"),
    ],
)
def test_wrong_coefficients_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=said):
        WindTunnel.model_validate(SLOW_FLYER | changes)


def test_the_model_needs_its_coefficients() -> None:
    data = with_tunnel("x500").model_dump()
    data["rotor_constants"]["wind_tunnel"] = None
    with pytest.raises(pydantic.ValidationError, match=r"rotor_model wind_tunnel needs rotor_constants\.wind_tunnel"):
        Vehicle.model_validate(data)
