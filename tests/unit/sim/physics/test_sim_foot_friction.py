"""Feet that hold better than the scene's ground: closed forms of Coulomb's friction."""

from __future__ import annotations

import numpy as np
import pytest

from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import ContactSphere, Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import Wind

TICK_NS = 4_000_000
MEADOW = load_scene("meadow")


def standing(name: str, friction: float | None, wind: Vec3 = (0.0, 0.0, 0.0)) -> VehiclePhysics:
    """Return a vehicle with heavy inertia, so that friction does not turn it, on feet of a coefficient."""
    vehicle = load_vehicle(name)
    feet = tuple(foot.model_copy(update={"friction": friction}) for foot in vehicle.feet)
    heavy = vehicle.model_copy(update={"feet": feet, "inertia_kgm2": (100.0, 100.0, 100.0)})
    disturbances = Disturbances(wind=Wind(steady_W_mps=wind))
    return VehiclePhysics(heavy, MEADOW, TICK_NS, start=FlightStart(), disturbances=disturbances)


def slowed_mps2(physics: VehiclePhysics, v: Vec3) -> float:
    """Return the mean deceleration of a vehicle that begins to slide, over 40 ms."""
    rest = physics.vehicle.rest_commands
    before = physics.advance(0, rest)
    physics.place(before.p_WB, before.q_WB, v)
    for tick in range(1, 11):
        truth = physics.advance(tick, rest)
    return float((np.linalg.norm(v) - np.linalg.norm(truth.v_WB_W)) / 0.04)


@pytest.mark.parametrize(("name", "speed_mps", "tolerance"), [("tailsitter", 1.2, 0.03), ("x500", 0.4, 0.1)])
def test_feet_brake_with_their_own_friction(name: str, speed_mps: float, tolerance: float) -> None:
    """With wings by `SlidingContact`, without by MuJoCo; the drag of the air is the same in both."""
    own, ground = (slowed_mps2(standing(name, friction), (0.0, speed_mps, 0.0)) for friction in (0.8, None))
    assert own - ground == pytest.approx((0.8 - MEADOW.ground_friction) * STANDARD_GRAVITY_MPS2, rel=tolerance)


def test_a_ground_that_holds_better_counts() -> None:
    assert slowed_mps2(standing("tailsitter", 0.1), (0.0, 1.2, 0.0)) == slowed_mps2(
        standing("tailsitter", None), (0.0, 1.2, 0.0)
    )
    assert ContactSphere(name="foot", position_m=(0, 0, 0), radius_m=0.1, friction=0.8).friction_on(1.0) == 1.0


@pytest.mark.parametrize(("friction", "slides"), [(0.8, False), (None, True)])
def test_a_tailsitter_in_wind_against_its_belly(friction: float | None, slides: bool) -> None:
    """Drag of 9.2 N at 6 m/s, of 15.9 N of weight."""
    physics = standing("tailsitter", friction, (-6.0, 0.0, 0.0))
    for tick in range(500):
        truth = physics.advance(tick, physics.vehicle.rest_commands)
    assert (truth.p_WB[0] < -0.5) == slides
    assert slides or abs(truth.p_WB[0]) < 1e-3


def test_the_shipped_tailsitter_stands_in_seven_metres_per_second() -> None:
    vehicle: Vehicle = load_vehicle("tailsitter")
    disturbances = Disturbances(wind=Wind(steady_W_mps=(-7.0, 0.0, 0.0)))
    physics = VehiclePhysics(vehicle, MEADOW, TICK_NS, start=FlightStart(), disturbances=disturbances)
    for tick in range(500):
        truth = physics.advance(tick, vehicle.rest_commands)
    assert abs(truth.p_WB[0]) < 1e-3
    assert vehicle.cos_tilt(truth.q_WB) == pytest.approx(1.0, abs=1e-4)
