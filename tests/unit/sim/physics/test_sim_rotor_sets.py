"""Rotors of several sets on one vehicle: the same flight as one set of equal rotors, closed forms of different ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from pydantic import ValidationError

from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics import multirotor, vtol
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.sensors.rotor_lines import vibration_arguments
from tests.unit.sim.physics.test_sim_tilts import wrench
from tests.worlds.motors import with_motors

TICK_NS = 4_000_000


def split(name: str, last: int = 2, model: str | None = None, **changes: Any) -> Vehicle:
    """Return a vehicle whose last rotors are a set of their own, with the same constants but for `changes`."""
    data: dict[str, Any] = yaml.safe_load((VEHICLE_DIR / f"{name}.yaml").read_text())
    for rotor in data["rotors"][-last:]:
        rotor["set"] = "others"
    constants = data["rotor_constants"] | changes
    data["rotor_model"] = model or data["rotor_model"]
    data["rotor_sets"] = {"others": {"rotor_model": data["rotor_model"], "rotor_constants": constants}}
    return Vehicle.model_validate(data)


def physics_of(vehicle: Vehicle, *faults: RotorFault, battery: bool = False) -> VehiclePhysics:
    return VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        TICK_NS,
        start=FlightStart(p_WB=(0.0, 0.0, 30.0)),
        effects=Effects(battery=battery),
        disturbances=Disturbances(faults=faults),
    )


def flown(physics: VehiclePhysics, ticks: int = 250) -> NDArray[np.float64]:
    """Return the states of a flight with random commands."""
    random = np.random.default_rng(7)
    rotors = len(physics.vehicle.rotors)
    states = []
    for tick in range(ticks):
        if tick % 25 == 0:
            controls = random.uniform(0.3, 0.8, rotors).tolist()
        physics.advance(tick, controls)
        states.append(physics.state.copy())
    return np.array(states)


@pytest.mark.parametrize("name", ["x500", "racer", "iris"])
def test_two_sets_of_equal_rotors_fly_like_one(name: str) -> None:
    one, two = flown(physics_of(load_vehicle(name))), flown(physics_of(split(name)))
    np.testing.assert_allclose(two, one, rtol=0.0, atol=1e-10)  # sums in another order


def test_two_sets_with_motors_and_a_battery_fly_like_one() -> None:
    whole = with_motors("x500")
    data = whole.model_dump()
    for rotor in data["rotors"][2:]:
        rotor["set"] = "others"
    data["rotor_sets"] = {"others": {"rotor_model": whole.rotor_model, "rotor_constants": data["rotor_constants"]}}
    two = Vehicle.model_validate(data)
    a, b = physics_of(whole, battery=True), physics_of(two, battery=True)
    np.testing.assert_allclose(flown(b), flown(a), rtol=0.0, atol=1e-9)
    assert a.battery is not None
    assert b.battery is not None
    assert b.battery.current_a == pytest.approx(a.battery.current_a, rel=1e-9)
    assert b.battery.charge == pytest.approx(a.battery.charge, rel=1e-12)
    assert a.battery.current_a > 5.0


def test_each_set_has_its_own_propeller() -> None:
    vehicle = split("x500", thrust_coefficient_n_per_radps2=2e-5, max_speed_radps=700.0, moment_ratio_m=0.02)
    force = wrench(vehicle, [0.6] * 4)
    own, others = 8.54858e-06 * 600.0**2, 2e-5 * 420.0**2
    assert force[2] == pytest.approx(2.0 * (own + others), rel=1e-12)
    assert force[5] == pytest.approx(-2.0 * own * 0.016 + 2.0 * others * 0.02, rel=1e-9)


def test_hover_command_carries_the_weight_with_all_sets() -> None:
    vehicle = split("x500", model="quadratic", max_speed_radps=800.0, thrust_model_factor=0.5)
    weight_n = vehicle.mass_kg * STANDARD_GRAVITY_MPS2
    control = multirotor.hover_control(vehicle)
    assert wrench(vehicle, [control] * 4)[2] == pytest.approx(weight_n, rel=1e-12)
    speeds = vehicle.hover_speeds_radps()
    assert 8.54858e-06 * sum(speed**2 for speed in speeds) == pytest.approx(weight_n, rel=1e-12)
    assert speeds[0] / 1000.0 == pytest.approx(speeds[3] / 800.0, rel=1e-12)


def test_a_fault_meets_the_rotor_of_its_number() -> None:
    fault = RotorFault(kind="stuck", rotor=3, at_s=0.1, speed_radps=0.0)
    physics = physics_of(split("x500"), fault)
    for tick in range(125):
        truth = physics.advance(tick, [0.6] * 4)
    assert truth.rotor_speed_radps[3] == pytest.approx(0.0, abs=1e-3)
    assert min(truth.rotor_speed_radps[:3]) > 590.0
    whole = physics_of(load_vehicle("x500"), fault)
    for tick in range(125):
        expected = whole.advance(tick, [0.6] * 4)
    np.testing.assert_allclose(truth.p_WB, expected.p_WB, rtol=0.0, atol=1e-10)


def test_the_battery_delivers_the_power_of_all_sets() -> None:
    physics, whole = physics_of(split("x500"), battery=True), physics_of(load_vehicle("x500"), battery=True)
    flown(physics)
    flown(whole)
    assert physics.battery is not None
    assert whole.battery is not None
    assert physics.battery.current_a == pytest.approx(whole.battery.current_a, rel=1e-9)


def test_vibration_has_the_lines_of_each_set() -> None:
    double = 2.0 * load_vehicle("x500").rotor_constants.thrust_coefficient_n_per_radps2
    place = (0.01, 0.0, 0.02)
    same = vibration_arguments(split("x500"), 1, place)
    other = vibration_arguments(split("x500", thrust_coefficient_n_per_radps2=double), 1, place)
    lines = len(same["order"])
    a, b = (np.reshape(of["cosine"], (4, lines, 6)) for of in (same, other))
    np.testing.assert_allclose(b[:2], a[:2])
    np.testing.assert_allclose(b[2:, 1:], 2.0 * a[2:, 1:])  # of the passing blades; the imbalance is the same


def test_the_part_that_lifts_leaves_the_pusher_out() -> None:
    data: dict[str, Any] = yaml.safe_load((VEHICLE_DIR / "x500.yaml").read_text())
    data["rotors"].append({"position_m": [-0.3, 0, 0], "axis": [1, 0, 0], "spin": "ccw", "set": "pusher"})
    data["rotor_sets"] = {"pusher": {"rotor_constants": data["rotor_constants"] | {"max_speed_radps": 900.0}}}
    data["forces"] = yaml.safe_load((VEHICLE_DIR / "aerosonde.yaml").read_text())["forces"]
    vehicle = Vehicle.model_validate(data)
    assert [force.commands for force in vehicle.make_forces(Effects())][:3] == [0, 4, 1]
    hover = vtol.hovering(vehicle)
    assert len(hover.rotors) == 4
    assert not hover.rotor_sets
    assert multirotor.unfit(hover) is None
    alone = load_vehicle("x500")
    assert multirotor.hover_control(vehicle) == multirotor.hover_control(hover) == multirotor.hover_control(alone)
    assert math.isinf(vehicle.hover_speeds_radps()[4])
    assert wrench(vehicle, [0.0] * 4 + [0.5] + [0.0] * 4)[0] == pytest.approx(8.54858e-06 * 450.0**2, rel=1e-12)


@pytest.mark.parametrize(
    ("sets", "text"),
    [
        ({0: "others", 2: "others"}, "rotors of the set 'others' are apart"),
        ({0: "others", 3: "front"}, "'front', which is no set of rotor_sets: it has others"),
        ({}, "rotor_sets.others has no rotors"),
    ],
)
def test_sets_that_cannot_be(sets: dict[int, str], text: str) -> None:
    data: dict[str, Any] = yaml.safe_load((VEHICLE_DIR / "x500.yaml").read_text())
    for rotor, name in sets.items():
        data["rotors"][rotor]["set"] = name
    data["rotor_sets"] = {"others": {"rotor_constants": data["rotor_constants"]}}
    with pytest.raises(ValidationError, match=text):
        Vehicle.model_validate(data)


def test_two_dead_times_are_refused() -> None:
    data = split("x500").model_dump()
    data["rotors"][0]["set"], data["rotors"][1]["set"] = "early", None
    data["rotor_constants"]["dead_time_s"] = 0.02
    data["rotor_sets"]["early"] = {"rotor_constants": data["rotor_constants"] | {"dead_time_s": 0.0}}
    data["rotor_sets"]["others"]["rotor_constants"]["dead_time_s"] = 0.01
    with pytest.raises(ValidationError, match=r"dead_time_s of the sets of rotors is 0, 0\.02, 0\.01"):
        Vehicle.model_validate(data)
