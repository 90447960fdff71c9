"""Vehicles that meet: conservation, rest on each other, reports, and bits that do not depend on others."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.flight_cases import torque_free
from signals.errors import ModelRangeError
from signals.rotation import matrix_of
from signals.samples import TruthState, Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.flight_start import FlightStart
from sim.physics.integration import Integration
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000
OFF = (0.0,) * 4
AIRFIELD = load_scene("airfield")
SPACE = AIRFIELD.model_copy(update={"gravity_mps2": 0.0})
HEIGHT_M = 300.0
STACKED_M = 0.292  # between the origins of two x500, the upper one's feet on the lower one's rotors
FLOATING = torque_free(load_vehicle("x500"))  # no forces but those of contact


def floating(p_W: Vec3, v_W: Vec3, *, vehicle: Vehicle = FLOATING, **options: bool) -> VehiclePhysics:
    """Return a vehicle in space at `p_W` above HEIGHT_M."""
    start = FlightStart(p_WB=(p_W[0], p_W[1], p_W[2] + HEIGHT_M))
    physics = VehiclePhysics(vehicle, SPACE, TICK_NS, start=start, integration=Integration(**options))
    physics.state[7:10] = v_W
    return physics


def fly(vehicles: Mapping[str, VehiclePhysics], ticks: int, controls: Sequence[float] = OFF) -> VehicleGroup:
    """Fly all vehicles with the same commands."""
    group = VehicleGroup(vehicles)
    for tick in range(ticks + 1):
        group.advance(tick, [controls] * len(vehicles))
    return group


def moments(vehicles: Sequence[VehiclePhysics]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return momentum, angular momentum about (0, 0, HEIGHT_M) in W, and kinetic energy."""
    linear, angular, energy = np.zeros(3), np.zeros(3), 0.0
    for physics in vehicles:
        p, v, w = physics.state[:3] - (0.0, 0.0, HEIGHT_M), physics.state[7:10], physics.state[10:13]
        mass, inertia = physics.vehicle.mass_kg, np.array(physics.vehicle.inertia_kgm2)
        turn = np.array(matrix_of(physics.state[3:7])).reshape(3, 3)
        linear += mass * v
        angular += mass * np.cross(p, v) + turn @ (inertia * w)
        energy += 0.5 * mass * float(v @ v) + 0.5 * float(inertia @ (w * w))
    return linear, angular, energy


@pytest.mark.parametrize("speed_mps", [0.5, 3.0, 20.0])
@pytest.mark.parametrize("offset_m", [0.02, 0.1])
def test_a_head_on_collision_keeps_momentum_and_gains_no_energy(speed_mps: float, offset_m: float) -> None:
    a = floating((-1.0, 0.0, 0.0), (speed_mps, 0.0, 0.0))
    b = floating((1.0, offset_m, offset_m), (-speed_mps, 0.0, 0.0))
    vehicles = {"a": a, "b": b}
    before, spin_before, energy_before = moments([a, b])
    group = VehicleGroup(vehicles)
    for tick in range(round(1.5e9 / speed_mps / TICK_NS)):
        group.advance(tick, [OFF, OFF])
        assert moments([a, b])[2] <= energy_before * (1.0 + 1e-12)
    after, spin_after, energy_after = moments([a, b])
    scale = a.vehicle.mass_kg * speed_mps
    assert energy_after < 0.5 * energy_before  # they met
    assert np.abs(after - before).max() <= 1e-9 * scale
    assert np.abs(spin_after - spin_before).max() <= 1e-9 * scale * offset_m


@pytest.mark.parametrize("speed_mps", [0.5, 1.0, 5.0, 10.0])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.7])
def test_restitution(speed_mps: float, phase: float) -> None:
    """Four feet come down on four rotors, so that nothing turns."""
    gap_m = (0.02 + 0.001 * phase) * speed_mps
    a, b = floating((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), floating((0.0, 0.0, STACKED_M + gap_m), (0.0, 0.0, -speed_mps))
    group = fly({"a": a, "b": b}, 30)
    restitution = (b.state[9] - a.state[9]) / speed_mps
    assert 0.05 <= restitution <= 0.17
    (contact,) = group.take_contacts()
    assert (contact.a, contact.b) == ("a", "b")
    assert contact.closing_mps == pytest.approx(speed_mps, rel=1e-9)
    reduced_kg = 0.5 * a.vehicle.mass_kg
    assert contact.impulse_ns == pytest.approx(reduced_kg * (1.0 + restitution) * speed_mps, rel=1e-6)
    assert abs(contact.t_ns / 1e9 - gap_m / speed_mps) <= 1.1e-3
    assert contact.point_W[2] == pytest.approx(HEIGHT_M + 0.063, abs=5e-3)


@pytest.mark.parametrize(
    ("upper", "offset_m", "height_m"), [("x500", 0.0, 0.3), ("x500", 0.03, 1.0), ("iris", 0.0, 0.5)]
)
def test_one_lands_on_another(upper: str, offset_m: float, height_m: float) -> None:
    lower, other = load_vehicle(upper), load_vehicle(upper)
    top_m = lower.rotors[0].position_m[2] + 0.005
    stacked_m = top_m + other.standing_height_m
    a = VehiclePhysics(lower, AIRFIELD, TICK_NS)
    start = FlightStart(p_WB=(offset_m, 0.0, lower.standing_height_m + stacked_m + height_m))
    b = VehiclePhysics(other, AIRFIELD, TICK_NS, start=start)
    group = VehicleGroup({"a": a, "b": b})
    for tick in range(500):
        states = group.advance(tick, [OFF, OFF])
        assert a.state[2] > lower.standing_height_m - 5e-3
        assert b.state[2] - a.state[2] > stacked_m - 5e-3
    assert all(state.in_contact for state in states)
    assert max(np.abs(a.state[7:13]).max(), np.abs(b.state[7:13]).max()) < 1e-3
    assert b.state[2] - a.state[2] == pytest.approx(stacked_m, abs=1e-3)
    contact = group.take_contacts()[0]
    assert contact.closing_mps == pytest.approx(math.sqrt(2.0 * STANDARD_GRAVITY_MPS2 * height_m), rel=0.02)


def test_three_in_a_row() -> None:
    """The first pushes the second into the third within one tick."""
    vehicles = {
        name: floating((0.0, 0.0, row * (STACKED_M + 0.001)), (0.0, 0.0, 10.0 * (row == 0)))
        for row, name in enumerate("abc")
    }
    before, _, energy_before = moments(list(vehicles.values()))
    group = fly(vehicles, 30)
    after, _, energy_after = moments(list(vehicles.values()))
    assert after == pytest.approx(before, rel=1e-9, abs=1e-9)
    assert energy_after < energy_before
    a, b, c = (physics.state[9] for physics in vehicles.values())
    assert 0.0 < a < b < c
    contacts = group.take_contacts(last=True)
    assert {(contact.a, contact.b) for contact in contacts} == {("a", "b"), ("b", "c")}
    assert len({contact.t_ns // TICK_NS for contact in contacts}) == 1


def course(seed: int, *, skipping: bool = True, reverse: bool = False, far: bool = False) -> dict[str, str]:
    """Return a digest of the states of each of six vehicles that tumble together onto the ground."""
    random = np.random.default_rng(seed)
    vehicles: dict[str, VehiclePhysics] = {}
    integration = Integration(contact_skipping=skipping)
    for name, kind in zip("abcdef", ("x500", "racer", "iris", "x500", "racer", "x500"), strict=True):
        away = random.normal(size=3)
        away *= random.uniform(1.0, 2.0) / np.linalg.norm(away)
        p_W = tuple((away + np.array([0.0, 0.0, 2.5])).tolist())
        physics = VehiclePhysics(
            load_vehicle(kind), AIRFIELD, TICK_NS, start=FlightStart(p_WB=p_W), integration=integration
        )
        physics.state[7:10], physics.state[10:13] = -3.0 * away, random.uniform(-4.0, 4.0, 3)
        vehicles[name] = physics
    if far:
        start = FlightStart(p_WB=(100.0, 0.0, 50.0))
        vehicles = {"0": VehiclePhysics(load_vehicle("x500"), AIRFIELD, TICK_NS, start=start)} | vehicles
    if reverse:
        vehicles = dict(reversed(vehicles.items()))
    levels = {name: float(random.uniform(0.0, 0.8)) for name in "abcdef"} | {"0": 0.5}
    group, digests = VehicleGroup(vehicles), {name: hashlib.sha256() for name in vehicles}
    for tick in range(150):
        for name, state in zip(vehicles, group.advance(tick, [(levels[name],) * 4 for name in vehicles]), strict=True):
            digests[name].update(repr(state).encode())
    contacts = group.take_contacts(last=True)
    assert len(contacts) > 2
    digests["a"].update(repr(contacts).encode())
    return {name: digests[name].hexdigest() for name in "abcdef"}


@pytest.mark.parametrize("seed", range(2))
def test_bits_do_not_depend_on_skipping_order_or_a_far_vehicle(seed: int) -> None:
    flown = course(seed)
    assert course(seed) == flown
    assert course(seed, skipping=False) == flown
    assert course(seed, reverse=True) == flown
    assert course(seed, far=True) == flown
    assert course(seed + 100) != flown


def test_vehicles_apart_fly_as_if_alone() -> None:
    def make(x_m: float) -> VehiclePhysics:
        return VehiclePhysics(load_vehicle("x500"), AIRFIELD, TICK_NS, start=FlightStart(p_WB=(x_m, 0.0, 0.5)))

    alone: list[list[TruthState]] = []
    for x_m in (0.0, 1.0):
        physics = make(x_m)
        alone.append([physics.advance(tick, (0.3,) * 4) for tick in range(150)])
    group = VehicleGroup({"a": make(0.0), "b": make(1.0)})
    together = [group.advance(tick, [(0.3,) * 4] * 2) for tick in range(150)]
    assert [list(states) for states in zip(*together, strict=True)] == alone
    assert alone[0][-1].in_contact


def test_a_rest_is_reported_once() -> None:
    """The upper vehicle is set down gently; the impulse counts 20 ms."""
    lower = VehiclePhysics(load_vehicle("x500"), AIRFIELD, TICK_NS)
    x, y, z = lower.state[:3].tolist()
    start = FlightStart(p_WB=(x, y, z + STACKED_M + 1e-4))
    group = fly({"lower": lower, "upper": VehiclePhysics(load_vehicle("x500"), AIRFIELD, TICK_NS, start=start)}, 400)
    (contact,) = group.take_contacts(last=True)
    assert contact.closing_mps < 0.1
    assert contact.impulse_ns < 2.5 * 0.02 * lower.vehicle.mass_kg * STANDARD_GRAVITY_MPS2


@pytest.mark.parametrize("speed_mps", [250.0, 1e9, math.inf, math.nan])
def test_errors_name_the_vehicle(speed_mps: float) -> None:
    wing = floating((9.0, 0.0, 0.0), (-speed_mps, 0.0, 0.0))
    group = VehicleGroup({"lead": floating((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "wing": wing}, downwash=True)
    group.advance(0, [OFF, OFF])
    with pytest.raises(ModelRangeError, match=r"wing/(speed_mps|state)"):
        group.advance(1, [OFF, OFF])


def test_errors_name_the_controls() -> None:
    group = VehicleGroup({"lead": floating((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))})
    group.advance(0, [OFF])
    with pytest.raises(ModelRangeError, match=r"lead/controls\[2\]"):
        group.advance(1, [(0.0, 0.0, math.nan, 0.0)])


def test_vehicles_of_a_group_share_scene_and_tick() -> None:
    here = floating((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="'b' has another scene or tick than 'a'"):
        VehicleGroup({"a": here, "b": VehiclePhysics(FLOATING, SPACE, 2_000_000)})
    with pytest.raises(ValueError, match="a group needs a vehicle"):
        VehicleGroup({})
