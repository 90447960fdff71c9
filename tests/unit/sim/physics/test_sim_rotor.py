"""Rotor effects against closed forms: ground, vortex ring, switches. tests/reference has them all in one solution."""

from __future__ import annotations

import math
from typing import Any

import pytest

from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene
from tests.worlds.rotor_models import quadratic

TICK_NS = 100_000  # short: accelerations are those of the start
RHO = 1.225


def bare(**constants: Any) -> Vehicle:
    """The x500 without drag, with its optional effects off unless given."""
    vehicle = quadratic("x500")
    off = {"ground_thrust_ratio": 1.0, "descent_loss": 0.0, "drag_kg_per_rad": 0.0}
    return vehicle.model_copy(
        update={
            "rotor_constants": vehicle.rotor_constants.model_copy(update=off | constants),
            "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
            "hull": (),
        }
    )


def thrust_ratio(
    vehicle: Vehicle,
    scene: Scene,
    *,
    hub_m: float = 300.0,
    v: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> float:
    """Thrust at hover command over the weight, level, hubs at `hub_m` above the ground."""
    height = hub_m - vehicle.rotors[0].position_m[2]
    physics = VehiclePhysics(vehicle, scene, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, height)))
    h = multirotor.hover_control(vehicle)
    physics.state[7:10] = v
    physics.state[13:] = multirotor.speed_radps(vehicle, h)
    physics.advance(0, (h,) * 4)
    truth = physics.advance(1, (h,) * 4)
    assert not truth.in_contact
    return truth.a_WB_W[2] / scene.gravity_mps2 + 1.0


def hover_inflow(vehicle: Vehicle) -> float:
    c = vehicle.rotor_constants
    return math.sqrt(vehicle.mass_kg * 9.80665 / 4 / (2 * RHO * math.pi * c.radius_m**2))


@pytest.mark.parametrize("radii", [2.5, 3.0, 4.0, 6.0])
def test_ground_effect_follows_cheeseman_and_bennett(radii: float, airfield: Scene) -> None:
    vehicle = bare(ground_thrust_ratio=2.0)
    ratio = thrust_ratio(vehicle, airfield, hub_m=radii * vehicle.rotor_constants.radius_m)
    theirs = 1.0 / (1.0 - (1.0 / (4.0 * radii)) ** 2)
    assert ratio == pytest.approx(theirs, abs=1e-3)
    floor, faded = 2.0 / (2.0 - 1.0), (1.0 - (radii / 32.0) ** 2) ** 4
    assert ratio == pytest.approx(1.0 / (1.0 - faded / (floor + (4.0 * radii) ** 2)), abs=2e-6)


def test_ground_effect_is_bounded_at_the_ground_and_gone_aloft(airfield: Scene) -> None:
    vehicle = bare(ground_thrust_ratio=1.6)
    raised = tuple(f.model_copy(update={"position_m": (*f.position_m[:2], 0.2)}) for f in vehicle.feet)
    low = vehicle.model_copy(
        update={
            "feet": raised,
            "rotors": tuple(r.model_copy(update={"position_m": (*r.position_m[:2], 0.0)}) for r in vehicle.rotors),
        }
    )
    assert thrust_ratio(low, airfield, hub_m=0.0) == pytest.approx(1.6, abs=1e-6)
    reach = 32 * vehicle.rotor_constants.radius_m
    assert thrust_ratio(vehicle, airfield, hub_m=reach * 1.001) == pytest.approx(1.0, abs=1e-12)
    assert thrust_ratio(vehicle, airfield, hub_m=reach * 0.9) > 1.0


def test_vortex_ring_takes_its_share_at_its_centre(airfield: Scene) -> None:
    vehicle = bare(descent_loss=0.3)
    v_h = hover_inflow(vehicle)
    assert thrust_ratio(vehicle, airfield, v=(0.0, 0.0, -1.45 * v_h)) == pytest.approx(0.7, abs=1e-4)
    for share, speed in ((0.5, 0.9332), (0.5, 2.2530)):  # 4 y / (1 + y)^2 = 1/2
        ratio = thrust_ratio(vehicle, airfield, v=(0.0, 0.0, -speed * v_h))
        assert 1.0 - ratio == pytest.approx(0.3 * share, abs=1e-3)
    assert thrust_ratio(vehicle, airfield, v=(0.0, 0.0, 3.0)) == pytest.approx(1.0, abs=1e-12)
    assert thrust_ratio(vehicle, airfield, v=(0.0, 0.0, -0.1 * v_h)) > 0.9999
    assert thrust_ratio(vehicle, airfield, v=(0.0, 0.0, -8.0 * v_h)) > 0.995  # windmill
    # One v_h of forward speed leaves a quarter of the loss.
    forward = thrust_ratio(vehicle, airfield, v=(v_h, 0.0, -1.45 * v_h))
    assert 1.0 - forward == pytest.approx(0.3 / 4, abs=1e-3)


def test_switches_leave_exactly_the_bare_model(airfield: Scene) -> None:
    full, off = quadratic("x500"), Effects(ground_effect=False, descent_loss=False)
    constants = full.rotor_constants.model_copy(update={"ground_thrust_ratio": 1.0, "descent_loss": 0.0})
    stripped = full.model_copy(update={"rotor_constants": constants})
    tracks = []
    for vehicle, effects in ((full, off), (stripped, Effects()), (full, Effects())):
        physics = VehiclePhysics(vehicle, airfield, 4_000_000, effects=effects, start=FlightStart(p_WB=(0.0, 0.0, 1.0)))
        physics.state[9] = -0.5
        tracks.append([physics.advance(tick, (0.7, 0.71, 0.7, 0.7)) for tick in range(40)])
    assert tracks[0] == tracks[1]
    assert tracks[0] != tracks[2]


def test_step_must_divide_the_tick(airfield: Scene) -> None:
    with pytest.raises(ValueError, match=r"step_ns 3000000 does not divide the tick of 4000000 ns"):
        VehiclePhysics(load_vehicle("x500"), airfield, 4_000_000, integration=Integration(step_ns=3_000_000))
