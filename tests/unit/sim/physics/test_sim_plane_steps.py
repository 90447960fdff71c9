"""Steps of planes: as few as accuracy needs. That they are short enough: tests/reference/test_plane_reference.py."""

from __future__ import annotations

import math

import pytest

from sim.physics.fixed_wing import Airframe
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS, TICK_S = 4_000_000, 0.004
PLANES = ["skywalker_x8", "aerosonde", "trainer"]


def in_flight(name: str) -> tuple[VehiclePhysics, list[float]]:
    """Return the physics and commands of cruise."""
    vehicle = load_vehicle(name)
    airframe = Airframe(vehicle)
    trim = airframe.trim(airframe.cruise_mps)
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 500.0)))
    physics.state[7:10] = trim.v_B_mps
    physics.state[13] = trim.throttle * vehicle.rotor_constants.max_speed_radps
    physics.advance(0, trim.controls)
    return physics, list(trim.controls)


@pytest.mark.parametrize("name", PLANES)
def test_cruise_takes_one_step_a_tick(name: str) -> None:
    physics, controls = in_flight(name)
    steps = []
    for tick in range(1, 51):
        physics.advance(tick, controls)
        steps.append(physics.body.steps())
    assert max(steps[5:]) == 1  # the trainer's engine follows its commands after a dead time


@pytest.mark.parametrize("name", PLANES)
def test_a_plane_at_rest_takes_few_steps(name: str) -> None:
    vehicle = load_vehicle(name)
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS)
    for tick in range(5):
        physics.advance(tick, (0.0,) * len(vehicle.commands))
    assert physics.body.steps() <= 8


def test_a_part_of_the_tick_ends_where_a_servo_leaves_its_limit() -> None:
    physics, controls = in_flight("skywalker_x8")
    full = [controls[0], 1.0, 1.0]
    corner_s = math.radians(35.0) / math.radians(200.0) - 0.034  # from the neutral angle, by hand
    whole, rest_s = divmod(corner_s, TICK_S)
    for tick in range(1, round(whole) + 1):
        physics.advance(tick, full)
        assert physics.body.steps() == 1
    physics.advance(round(whole) + 1, full)
    assert physics.body.steps() == 2
    way_m = [physics.body.way_in_substep(step) for step in range(2)]
    assert way_m[0] / sum(way_m) == pytest.approx(rest_s / TICK_S, abs=0.01)
