"""Ground: rest on the feet and on the hull. Landings and walls are swept in tests/accuracy/test_physics_contact.py."""

from __future__ import annotations

import numpy as np
import pytest

from signals.rotation import matrix_of
from signals.samples import TruthState
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.forces.rotors import Spin
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import load_vehicle, vehicle_names
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene

TICK_NS = 4_000_000
OFF = (0.0,) * 8
VEHICLES = vehicle_names()


def upright(truth: TruthState) -> float:
    """Cosine of the tilt."""
    _, x, y, _ = truth.q_WB
    return 1.0 - 2.0 * (x * x + y * y)


@pytest.mark.parametrize("name", VEHICLES)
def test_stands_still(name: str, airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle(name), airfield, TICK_NS, start=FlightStart(yaw_rad=0.7))
    start = physics.advance(0, OFF)
    assert start.in_contact
    # Wheels roll until their springs are in balance, which a pitch of 2e-5 rad is away from.
    way_m, speed = (3e-4, 3e-4) if physics.vehicle.rolls else (1e-6, 1e-6)
    for tick in range(1, 1251):
        truth = physics.advance(tick, OFF)
        assert truth.p_WB == pytest.approx(start.p_WB, abs=way_m)
        assert max(abs(v) for v in truth.v_WB_W + truth.w_WB_B) < speed
        assert truth.in_contact
    assert max(abs(v) for v in truth.v_WB_W + truth.w_WB_B) < 2e-6
    if physics.vehicle.rolls:
        return
    feet = physics.vehicle.feet
    # All feet stand on the ground, also those of a plane that rests on its tail.
    bottoms = [start.p_WB[2] + np.dot(matrix_of(start.q_WB)[6:], foot.position_m) - foot.radius_m for foot in feet]
    assert bottoms == pytest.approx([0.0] * len(feet), abs=1e-4)
    if len({foot.position_m[2] - foot.radius_m for foot in feet}) == 1:
        assert start.p_WB[2] == pytest.approx(physics.vehicle.standing_height_m, abs=1e-4)


@pytest.mark.parametrize("name", multirotor_names())
def test_idling_rotors_do_not_walk_it(name: str, airfield: Scene) -> None:
    """Half the hover thrust with a yaw torque: the feet hold it."""
    physics = VehiclePhysics(load_vehicle(name), airfield, TICK_NS)
    start = physics.advance(0, OFF)
    hover = multirotor.hover_control(physics.vehicle)
    controls = [hover * (0.5 if rotor.spin is Spin.CCW else 0.4) for rotor in physics.vehicle.rotors]
    for tick in range(1, 1251):
        truth = physics.advance(tick, controls)
    assert truth.p_WB == pytest.approx(start.p_WB, abs=2e-3)
    assert abs(truth.q_WB[3]) < 5e-3


def test_upside_down_rests_on_its_hull(airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("x500"), airfield, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 0.2)))
    physics.state[3:7] = (0.0, 1.0, 0.0, 0.0)
    physics.advance(0, OFF)
    for tick in range(1, 501):
        truth = physics.advance(tick, OFF)
    assert upright(truth) < -0.99
    assert 0.03 < truth.p_WB[2] < 0.1
