"""A world that is stepped from outside: vehicles are added, placed and reset at any time."""

from __future__ import annotations

import math

import pytest

from hil.run.stepped.ideal_controller import IdealController, Setpoint
from hil.run.stepped.world import SteppedWorld
from signals.samples import TruthState
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000
X500 = load_vehicle("x500")
AIRFIELD = load_scene("airfield")


def hovering(world: SteppedWorld, name: str, height_m: float, start: FlightStart = FlightStart()) -> None:  # noqa: B008
    """Add a vehicle that flies to a height above its start."""
    vehicle = world.add(name, X500, start)
    controller = IdealController(X500, TICK_NS, AIRFIELD.gravity_mps2)
    x, y, _ = vehicle.truth.p_WB
    setpoint = Setpoint(p_xy_m=(x, y), z_m=height_m, yaw_rate_radps=0.0)
    vehicle.pilot = lambda truth: controller.controls(truth, setpoint)


def run(world: SteppedWorld, seconds: float) -> None:
    for _ in range(round(seconds * 1e9 / TICK_NS)):
        world.step()


def test_a_vehicle_without_a_pilot_stands() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    vehicle = world.add("a", X500)
    run(world, 0.2)
    assert vehicle.truth.p_WB == pytest.approx(vehicle.start.p_WB, abs=1e-6)
    assert vehicle.truth.t_ns == world.t_ns == 200_000_000


def test_the_bits_of_a_flight_alone() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    vehicle = world.add("a", X500)
    vehicle.pilot = lambda _truth: (0.8, 0.7, 0.8, 0.7)
    alone = VehiclePhysics(X500, AIRFIELD, TICK_NS)
    for tick in range(200):
        expected = alone.advance(tick, (0.8, 0.7, 0.8, 0.7))
        assert vehicle.truth == expected
        world.step()


def test_vehicles_join_and_fly_together() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    hovering(world, "a", 3.0)
    run(world, 1.0)
    hovering(world, "b", 2.0, FlightStart(ground_W=(5.0, 0.0, 0.0)))
    run(world, 6.0)
    assert world.vehicles["a"].truth.p_WB[2] == pytest.approx(3.0, abs=0.02)
    assert world.vehicles["b"].truth.p_WB == pytest.approx((5.0, 0.0, 2.0), abs=0.02)
    with pytest.raises(ValueError, match="there is a vehicle 'b' already"):
        world.add("b", X500)


def test_place_and_reset() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    vehicle = world.add("a", X500)
    vehicle.place((1.0, 2.0, 30.0), v_WB_W=(0.0, 0.0, -3.0))
    assert vehicle.truth.p_WB == (1.0, 2.0, 30.0)
    run(world, 0.1)
    assert vehicle.truth.v_WB_W[2] == pytest.approx(-3.98, abs=0.05)
    vehicle.reset()
    assert vehicle.truth.p_WB == vehicle.start.p_WB
    assert vehicle.truth.t_ns == world.t_ns


def test_a_vehicle_without_physics_stands_where_it_is_put() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    vehicle = world.stand("a", X500)
    vehicle.place((1.0, 2.0, 30.0))
    run(world, 0.1)
    assert vehicle.truth.p_WB == (1.0, 2.0, 30.0)
    assert vehicle.truth.t_ns == world.t_ns
    assert vehicle.touch() is None
    vehicle.place((1.0, 2.0, 0.1))
    contact = vehicle.touch()
    assert contact is not None
    assert contact.name == "ground"
    assert contact.depth_m == pytest.approx(X500.standing_height_m - 0.1, abs=1e-9)
    vehicle.reset()
    assert vehicle.truth.p_WB == vehicle.start.p_WB


def test_a_vehicle_that_leaves_the_models_range_is_stopped_and_reported() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    hovering(world, "a", 3.0)
    fast = world.add("b", X500, FlightStart(p_WB=(20.0, 0.0, 40.0)))
    run(world, 0.02)
    before = world.vehicles["a"].truth.t_ns
    fast.place((49_999.7, 0.0, 40.0), v_WB_W=(100.0, 0.0, 0.0))
    run(world, 0.004)
    departures = [departure.message for departure in world.take_departures()]
    assert len(departures) == 1
    assert "b/distance_from_site_m" in departures[0]
    assert fast.truth.p_WB == (49_999.7, 0.0, 40.0)
    assert fast.truth.v_WB_W == (0.0, 0.0, 0.0)
    assert world.vehicles["a"].truth.t_ns > before
    fast.pilot = None
    run(world, 0.2)
    assert world.take_departures() == []
    assert world.vehicles["a"].truth.t_ns == world.vehicles["b"].truth.t_ns == world.t_ns


def test_a_pilots_command_must_be_finite() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    world.add("a", X500).pilot = lambda _truth: (math.nan, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"^a: the pilot commanded \[nan, 0.0, 0.0, 0.0\]"):
        world.step()


def test_wind() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    world.set_wind((8.0, 0.0, 0.0))
    assert world.wind_W_mps == (8.0, 0.0, 0.0)
    drifting = world.add("a", X500, FlightStart(p_WB=(0.0, 0.0, 50.0)))
    run(world, 1.0)
    assert drifting.truth.p_WB[0] > 0.05
    world.set_wind((-8.0, 0.0, 0.0))
    drifting.place((0.0, 0.0, 50.0))
    run(world, 1.0)
    assert drifting.truth.p_WB[0] < -0.05


def test_observers_see_every_tick() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    world.add("a", X500)
    seen: list[TruthState] = []
    world.observers.append(lambda world: seen.append(world.vehicles["a"].truth))
    run(world, 0.04)
    assert [truth.tick for truth in seen] == list(range(1, 11))


def test_a_vehicle_with_an_empty_battery_falls_and_is_reported_once() -> None:
    battery = X500.battery
    assert battery is not None
    small = X500.model_copy(update={"battery": battery.model_copy(update={"initial_charge": 2e-4})})
    world = SteppedWorld(AIRFIELD, TICK_NS)
    vehicle = world.add("a", small, FlightStart(p_WB=(0.0, 0.0, 40.0)), effects=Effects(battery=True))
    vehicle.pilot = lambda _truth: (0.7, 0.7, 0.7, 0.7)
    run(world, 10.0)
    assert ["battery_charge" in each.message for each in world.take_departures()] == [True]
    assert vehicle.truth.p_WB[2] < 1.0
    assert vehicle.truth.rotor_speed_radps == (0.0,) * 4
    vehicle.reset()
    run(world, 0.1)
    assert min(vehicle.truth.rotor_speed_radps) > 100.0


@pytest.mark.parametrize("gravity_mps2", [9.8, 0.0])
def test_held_ticks_of_the_ideal_controller_have_the_bits_of_single_ones(gravity_mps2: float) -> None:
    scene = AIRFIELD.model_copy(update={"gravity_mps2": gravity_mps2})
    held, stepped = SteppedWorld(scene, TICK_NS), SteppedWorld(scene, TICK_NS)
    a, b = held.add("a", X500), stepped.add("a", X500)
    flies_a, flies_b = (IdealController(X500, TICK_NS, gravity_mps2) for _ in range(2))
    contacts = 0
    for climb_mps, ticks in ((2.0, 500), (0.0, 77), (-3.0, 600), (1.0, 9)):  # up, hold, down to the ground, up
        setpoint = Setpoint(v_xy_mps=(1.0, 0.5), vz_mps=climb_mps, yaw_rate_radps=0.2)
        flies_a.aim(setpoint)
        held.hold(flies_a.kernel, ticks)
        b.pilot = lambda truth, setpoint=setpoint: flies_b.controls(truth, setpoint)  # type: ignore[misc]
        for _ in range(ticks):
            stepped.step()
            contacts += b.truth.in_contact
        assert a.truth == b.truth
        assert all(map(math.isfinite, a.truth.p_WB))
    assert contacts > 100 or gravity_mps2 == 0.0


def test_a_restarted_world_has_the_bits_of_a_new_one() -> None:
    worlds = [SteppedWorld(AIRFIELD, TICK_NS, seed=seed) for seed in (5, 3)]
    truths = []
    for world in worlds:
        hovering(world, "a", 3.0)
        run(world, 2.0)
    worlds[0].restart(3)
    assert worlds[0].tick == 0
    for world in (worlds[0], SteppedWorld(AIRFIELD, TICK_NS, seed=3)):
        if not world.vehicles:
            world.add("a", X500)
        world.vehicles["a"].pilot = lambda _truth: (0.75, 0.75, 0.76, 0.75)
        run(world, 1.0)
        truths.append(world.vehicles["a"].truth)
    assert truths[0] == truths[1]


def test_hold_refuses_other_worlds() -> None:
    world = SteppedWorld(AIRFIELD, TICK_NS)
    world.add("a", X500)
    with pytest.raises(ValueError, match="every command must be finite"):
        world.hold((0.5, math.nan, 0.5, 0.5), 3)
    world.add("b", X500, FlightStart(ground_W=(5.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="a single vehicle"):
        world.hold((0.5,) * 4, 3)
