"""A vehicle that is placed elsewhere between two ticks flies on with the bits of a new one that starts there."""

from __future__ import annotations

import time
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from signals.samples import Quat, TruthState, Vec3
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Box, Scene, load_scene
from sim.scene.wind import Wind
from sim.world_loader import load_world

TICK_NS = 4_000_000
X500 = load_vehicle("x500")
AIRFIELD = load_scene("airfield")
TILTED: Quat = (0.9, 0.1, -0.2, 0.3)


def unit(q: Quat) -> Quat:
    length = float(np.sqrt(np.dot(q, q)))
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def flight(physics: VehiclePhysics, first: int, ticks: int, controls: Sequence[float]) -> list[TruthState]:
    """Return the states of the next ticks, numbered from 1."""
    states = [physics.advance(first + k, controls) for k in range(ticks)]
    return [state._replace(tick=k + 1, t_ns=(k + 1) * TICK_NS) for k, state in enumerate(states)]


def new(scene: Scene, p_W: Vec3, **options: bool) -> VehiclePhysics:
    physics = VehiclePhysics(X500, scene, TICK_NS, start=FlightStart(p_WB=p_W), integration=Integration(**options))
    physics.advance(0, ())
    return physics


@pytest.mark.parametrize("height_m", [0.24, 0.6, 30.0])  # with and without contact afterwards
@pytest.mark.parametrize("skipping", [True, False])
def test_the_flight_after_place_has_the_bits_of_a_new_one(height_m: float, skipping: bool) -> None:
    p_W, v_W, w_B = (3.0, -2.0, height_m), (1.5, 0.5, -1.0), (0.3, -0.2, 0.1)
    flown = VehiclePhysics(X500, AIRFIELD, TICK_NS, integration=Integration(contact_skipping=skipping))
    flight(flown, 0, 300, (0.9, 0.2, 0.9, 0.3))  # tumbles into the ground
    placed = flown.place(p_W, TILTED, v_W, w_B)
    fresh = new(AIRFIELD, p_W, contact_skipping=skipping)
    fresh.state[3:7], fresh.state[7:10], fresh.state[10:13] = unit(TILTED), v_W, w_B
    assert placed.p_WB == p_W
    assert placed.a_WB_W == placed.alpha_WB_B == (0.0, 0.0, 0.0)
    controls = (0.3, 0.35, 0.3, 0.3)
    assert flight(flown, 300, 400, controls) == flight(fresh, 1, 400, controls)
    assert flown.skips.touching > 0


def test_rotor_speeds_may_be_given() -> None:
    flown, fresh = VehiclePhysics(X500, AIRFIELD, TICK_NS), new(AIRFIELD, (0.0, 0.0, 5.0))
    flight(flown, 0, 20, (0.5,) * 4)
    speeds = (500.0, 510.0, 490.0, 505.0)
    assert flown.place((0.0, 0.0, 5.0), rotor_speed_radps=speeds).rotor_speed_radps == speeds
    fresh.state[13:] = speeds
    assert flight(flown, 20, 50, (0.5,) * 4) == flight(fresh, 1, 50, (0.5,) * 4)


@pytest.mark.parametrize("start", [FlightStart(), FlightStart(ground_W=(4.0, 1.0, 0.0), yaw_rad=1.0)])
def test_reset_returns_to_the_start(start: FlightStart) -> None:
    flown = VehiclePhysics(X500, AIRFIELD, TICK_NS, start=start, effects=Effects(battery=True))
    fresh = VehiclePhysics(X500, AIRFIELD, TICK_NS, start=start, effects=Effects(battery=True))
    first = fresh.advance(0, ())
    flight(flown, 0, 300, (0.8, 0.7, 0.8, 0.7))
    assert flown.reset()[2:] == first[2:]
    assert flight(flown, 300, 300, (0.75,) * 4) == flight(fresh, 1, 300, (0.75,) * 4)
    assert flown.battery == fresh.battery


def test_a_thousand_resets_leave_no_trace() -> None:
    physics = VehiclePhysics(X500, AIRFIELD, TICK_NS)
    tick, ends = 0, set()
    for _ in range(1000):
        ends.add(flight(physics, tick, 6, (0.9, 0.9, 0.9, 0.8))[-1].p_WB if tick else None)
        tick += 6
        if tick == 6:
            flight(physics, 0, 6, (0.9, 0.9, 0.9, 0.8))
        physics.reset()
    assert len(ends) == 2


def test_wind_goes_on() -> None:
    wind = Wind(steady_W_mps=(3.0, 0.0, 0.0))
    flown = VehiclePhysics(X500, AIRFIELD, TICK_NS, disturbances=Disturbances(wind=wind))
    flight(flown, 0, 10, (0.6,) * 4)
    flown.place((0.0, 0.0, 50.0))
    assert flown.wind_W_mps == (3.0, 0.0, 0.0)
    assert flight(flown, 10, 100, (0.0,) * 4)[-1].p_WB[0] > 0.001
    flown.set_steady_wind((-3.0, 0.0, 0.0))
    flown.place((0.0, 0.0, 50.0))
    assert flight(flown, 110, 100, (0.0,) * 4)[-1].p_WB[0] < -0.001


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (((0.0, 0.0, 60e3),), "p_WB"),
        (((float("nan"), 0.0, 0.0),), "p_WB"),
        (((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)), "q_WB"),
        (((0.0, 0.0, 1.0), (float("nan"), 0.0, 0.0, 0.0)), "q_WB"),
        (((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (300.0, 0.0, 0.0)), "v_WB_W"),
        (((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 201.0, 0.0)), "w_WB_B"),
        (((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, (1.0, 1.0)), "rotor_speed_radps"),
    ],
)
def test_a_state_beyond_the_model_is_refused_and_changes_nothing(arguments: tuple[object, ...], named: str) -> None:
    physics = VehiclePhysics(X500, AIRFIELD, TICK_NS)
    before = physics.advance(0, ())
    with pytest.raises(ValueError, match=f"^{named}"):
        physics.place(*arguments)  # type: ignore[arg-type]
    assert physics.truth == before


def test_a_vehicle_joins_a_group_that_flies() -> None:
    a, b = VehiclePhysics(X500, AIRFIELD, TICK_NS), new(AIRFIELD, (9.0, 0.0, 3.0))
    for tick in range(5):
        a.advance(tick, (0.0,) * 4)
    joined = VehiclePhysics(X500, AIRFIELD, TICK_NS, start=FlightStart(p_WB=(9.0, 0.0, 3.0)))
    assert joined.join(4).p_WB == (9.0, 0.0, 3.0)
    group = VehicleGroup({"a": a, "b": joined})
    states = [group.advance(tick, [(0.0,) * 4, (0.4,) * 4])[1] for tick in range(5, 55)]
    alone = flight(b, 1, 50, (0.4,) * 4)
    assert [state[2:] for state in states] == [state[2:] for state in alone]
    with pytest.raises(ValueError, match="only a vehicle that has not flown"):
        joined.join(9)


def test_the_contact_of_a_vehicle_on_the_ground() -> None:
    physics = VehiclePhysics(X500, AIRFIELD, TICK_NS)
    flight(physics, 0, 5, (0.0,) * 4)
    contact = physics.contact()
    assert contact is not None
    assert contact.name == "ground"
    assert contact.normal_W == (0.0, 0.0, 1.0)
    assert 0.0 < contact.depth_m < 1e-4
    assert abs(contact.point_W[2]) < 1e-4


def test_the_contact_names_the_box_that_a_vehicle_hits() -> None:
    tower = Box(name="tower", center_m=(5.0, 0.0, 2.0), size_m=(2.0, 2.0, 4.0))
    physics = VehiclePhysics(X500, AIRFIELD.model_copy(update={"boxes": (tower,)}), TICK_NS)
    physics.advance(0, ())
    physics.place((5.0, 0.0, 4.5))
    assert physics.touch(0) is None
    tick = 1
    while not physics.advance(tick, (0.0,) * 4).in_contact:
        tick += 1
    contact = physics.contact()
    assert contact is not None
    assert contact.name == "tower"
    assert contact.normal_W == pytest.approx((0.0, 0.0, 1.0))
    assert contact.point_W[2] == pytest.approx(4.0, abs=0.02)
    physics.place((3.8, 0.0, 2.0))
    beside = physics.touch(0)
    assert beside is not None
    assert beside.name == "tower"
    assert beside.normal_W == pytest.approx((-1.0, 0.0, 0.0))


def test_the_contact_names_a_geom_of_a_map() -> None:
    scene = load_scene("training_village")
    physics = VehiclePhysics(X500, scene, TICK_NS)
    world = load_world(scene)
    solid = {mujoco.mj_id2name(world.model, mujoco.mjtObj.mjOBJ_GEOM, i) for i in np.flatnonzero(world.geom_solid)}
    bodies = {world.model.body(i).name for i in range(world.model.nbody)}
    found = set()
    for x in np.linspace(-60.0, 60.0, 25):
        for y in np.linspace(-60.0, 60.0, 25):
            physics.place((float(x), float(y), 1.5))
            contact = physics.touch(0)
            if contact is not None:
                assert bool(world.geom_solid[contact.geom])
                found.add(contact.name)
    assert len(found) > 3
    assert found <= solid | bodies


def test_place_takes_less_than_half_a_dozen_ticks() -> None:
    scene = load_scene("training_village")
    physics = VehiclePhysics(X500, scene, TICK_NS)
    flight(physics, 0, 50, (0.0,) * 4)
    began = time.process_time()
    for _ in range(200):
        physics.place((1.0, 2.0, 20.0))
    placing = time.process_time() - began
    began = time.process_time()
    flight(physics, 50, 1000, (0.0,) * 4)
    assert placing < 6 * (time.process_time() - began) / 5


def test_a_vehicle_becomes_another_of_its_shape() -> None:
    """It flies and touches the ground with the bits of a new one, placed where that one is."""
    c = X500.rotor_constants
    other = X500.model_copy(
        update={
            "mass_kg": 1.3 * X500.mass_kg,
            "inertia_kgm2": (0.02, 0.025, 0.03),
            "rotor_constants": c.model_copy(update={"time_constant_up_s": 2.0 * c.time_constant_up_s}),
        }
    )
    changed, new = VehiclePhysics(X500, AIRFIELD, TICK_NS), VehiclePhysics(other, AIRFIELD, TICK_NS)
    flight(changed, 0, 30, (0.8,) * 4)
    changed.become(other)
    for physics in (changed, new):
        physics.restart(1)
        physics.place((0.0, 0.0, 0.6), TILTED, v_WB_W=(0.5, 0.0, -2.0))
    a, b = flight(changed, 1, 250, (0.4,) * 4), flight(new, 1, 250, (0.4,) * 4)
    assert a == b
    assert any(state.in_contact for state in a)
    with pytest.raises(ValueError, match="one of its own shape only"):
        changed.become(load_vehicle("x500").model_copy(update={"feet": X500.feet[:3]}))
