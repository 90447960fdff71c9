"""Aircraft by stability derivatives: printed equations, stall, the whole sphere of directions, products of inertia."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from sim.physics.fixed_wing import Airframe
from sim.physics.flight_start import FlightStart
from sim.physics.forces.aero_table import AeroTable
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.unit.sim.physics.test_fixed_wing import table_of

RHO = 1.225


def without_propeller(name: str) -> Vehicle:
    """Return a plane whose propeller makes no force."""
    vehicle = load_vehicle(name)
    none = {"thrust_coefficient_n_per_radps2": 1e-30, "drag_kg_per_rad": 0.0, "inertia_kgm2": 0.0}
    constants = vehicle.rotor_constants.model_copy(update=none)
    return vehicle.model_copy(update={"rotor_constants": constants, "rotor_model": "quadratic"})


def loads(vehicle: Vehicle, a_F: Any, w_F: Any = (0.0, 0.0, 0.0), commands: Any = None) -> np.ndarray:
    """Return force and torque in F (x ahead, y right, z down) of the air at a velocity and rates in F."""
    flip = np.array([1.0, -1.0, -1.0])
    airframe = Airframe(vehicle)
    surfaces = np.zeros(len(airframe.surfaces)) if commands is None else np.array(commands)
    load = airframe.wrench(flip * np.array(a_F), flip * np.array(w_F), airframe.controls(0.0, surfaces))
    return load * np.concatenate([flip, flip])


def wind(V: float, alpha: float, beta: float) -> np.ndarray:
    return V * np.array([math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)])


def test_the_equations_as_they_are_printed() -> None:
    """Beard and McLain, eq. 4.6 to 4.20, with the numbers of the Aerosonde, far from stall."""
    V, alpha, beta, (p, q, r) = 30.0, 0.06, 0.05, (0.3, -0.2, 0.1)
    da, de, dr = math.radians(25.0) * np.array([0.2, -0.3, 0.4])
    S, c, b = 0.55, 0.18994, 2.8956
    found = loads(without_propeller("aerosonde"), wind(V, alpha, beta), (p, q, r), [0.2, -0.3, 0.4])
    line = 0.28 + 3.45 * alpha
    C_L = line - 0.36 * de
    C_D = 0.0437 + line**2 / (math.pi * 0.9 * b**2 / S)
    C_Y = -0.98 * beta - 0.17 * dr
    C_l = -0.12 * beta + b / (2 * V) * (-0.26 * p + 0.14 * r) + 0.08 * da + 0.105 * dr
    C_m = -0.02338 - 0.38 * alpha - 3.6 * c / (2 * V) * q - 0.5 * de
    C_n = 0.25 * beta + b / (2 * V) * (0.022 * p - 0.35 * r) + 0.06 * da - 0.032 * dr
    pressure = 0.5 * RHO * V**2 * S
    exact = pressure * np.array(
        [
            -C_D * math.cos(alpha) + C_L * math.sin(alpha),
            C_Y,
            -C_D * math.sin(alpha) - C_L * math.cos(alpha),
            b * C_l,
            c * C_m,
            b * C_n,
        ]
    )
    assert found == pytest.approx(exact, rel=2e-7, abs=1e-6)


def test_lift_beyond_the_stall_is_that_of_a_flat_plate() -> None:
    """Beard and McLain, eq. 4.9: 2 sin^2(alpha) cos(alpha), to the smoothed corner of the plate."""
    vehicle, V = without_propeller("skywalker_x8"), 15.0
    pressure = 0.5 * RHO * V**2 * table_of(vehicle).area_m2
    for degrees in (35.0, 60.0, 90.0, 120.0, -45.0):
        alpha = math.radians(degrees)
        force = loads(vehicle, wind(V, alpha, 0.0))
        lift = (force[0] * math.sin(alpha) - force[2] * math.cos(alpha)) / pressure
        plate = 2.0 * math.sin(alpha) * abs(math.sin(alpha)) * math.cos(alpha)
        assert lift == pytest.approx(plate, rel=5e-3, abs=1e-9)


def test_lift_falls_at_the_stall() -> None:
    vehicle = without_propeller("skywalker_x8")
    angles = np.radians(np.arange(0.0, 40.0, 0.5))
    lift = [-loads(vehicle, wind(15.0, alpha, 0.0))[2] for alpha in angles]
    assert 11.0 < math.degrees(angles[int(np.argmax(lift))]) < 16.0
    assert min(lift[30:40]) < 0.8 * max(lift)


@pytest.mark.parametrize("name", ["skywalker_x8", "aerosonde"])
def test_no_direction_and_no_airspeed_is_singular(name: str) -> None:
    """Loads grow with V^2 in every direction, and each is continuous; in still air only rates could damp."""
    vehicle = without_propeller(name)
    airframe = Airframe(vehicle)
    controls = airframe.controls(0.0, np.full(len(airframe.surfaces), 0.3))
    directions = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
    directions = np.concatenate([directions, np.random.default_rng(1).normal(size=(300, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for direction in directions:
        one = airframe.wrench(direction, (0.0, 0.0, 0.0), controls)
        ten = airframe.wrench(10.0 * direction, (0.0, 0.0, 0.0), controls)
        assert np.isfinite(one).all()
        assert ten == pytest.approx(100.0 * one, rel=1e-9, abs=1e-9)
        assert np.abs(one).max() < 5.0 * RHO * table_of(vehicle).area_m2 * table_of(vehicle).span_m
        near = airframe.wrench(direction + 1e-7 * direction[[1, 2, 0]], (0.0, 0.0, 0.0), controls)
        assert near == pytest.approx(one, abs=2e-5)
    assert airframe.wrench((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), controls) == pytest.approx(np.zeros(6), abs=1e-30)
    assert airframe.wrench((1e-200, 0.0, 1e-200), (1.0, 2.0, 3.0), controls) == pytest.approx(np.zeros(6), abs=1e-30)


def test_elevons_mix_as_the_source_says() -> None:
    """Both down are elevator, left down alone half of it, and half an aileron that rolls right."""
    vehicle = without_propeller("skywalker_x8")
    flow = wind(18.0, 0.03, 0.0)
    neutral = loads(vehicle, flow)
    both, left = loads(vehicle, flow, commands=[0.1, 0.1]), loads(vehicle, flow, commands=[0.1, 0.0])
    assert (both - neutral)[4] < 0.0  # nose down
    assert (both - neutral)[3] == pytest.approx(0.0, abs=1e-12)
    assert (left - neutral)[4] == pytest.approx(0.5 * (both - neutral)[4], rel=1e-9)
    assert (left - neutral)[3] > 0.0


def test_the_reference_point_has_a_lever() -> None:
    vehicle = without_propeller("aerosonde")
    table = table_of(vehicle)
    moved = vehicle.model_copy(update={"forces": (table.model_copy(update={"reference_m": (0.1, 0.0, 0.0)}),)})
    before, after = loads(vehicle, wind(30.0, 0.05, 0.02)), loads(moved, wind(30.0, 0.05, 0.02))
    assert after[:3] == pytest.approx(before[:3], rel=1e-15)
    assert after[4] - before[4] == pytest.approx(-0.1 * before[2], rel=1e-9)  # r x F in F
    assert after[5] - before[5] == pytest.approx(0.1 * before[1], rel=1e-9)


def test_density_follows_the_height() -> None:
    """At 2000 m the air is 82 % as dense as at the sea, and the lift with it."""
    scene = load_scene("airfield")
    vehicle = without_propeller("skywalker_x8")
    accelerations = []
    for height in (0.0, 2000.0):
        physics = VehiclePhysics(vehicle, scene, 100_000, start=FlightStart(p_WB=(0.0, 0.0, height + 50.0)))
        physics.state[7:10] = (20.0, 0.0, -1.0)
        physics.advance(0, (0.0, 0.0, 0.0))
        accelerations.append(physics.advance(1, (0.0, 0.0, 0.0)).a_WB_W[2] + scene.gravity_mps2)
    assert accelerations[1] / accelerations[0] == pytest.approx(0.822, abs=0.01)


def test_a_tumbling_body_with_products_of_inertia_keeps_energy_and_momentum() -> None:
    vehicle = without_propeller("aerosonde")
    bare = vehicle.model_copy(update={"forces": (), "inertia_products_kgm2": (0.05, -0.12, 0.08), "rotors": ()})
    scene = load_scene("airfield").model_copy(update={"gravity_mps2": 0.0})
    physics = VehiclePhysics(bare, scene, 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 500.0)))
    physics.state[10:13] = (9.0, -6.0, 5.0)
    tensor = bare.inertia_tensor_kgm2

    def invariants(truth: Any) -> tuple[float, np.ndarray]:
        w, x, y, z = truth.q_WB
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        R, rate = np.eye(3) + 2 * w * skew + 2 * skew @ skew, np.array(truth.w_WB_B)
        return 0.5 * float(rate @ tensor @ rate), R @ (tensor @ rate)

    energy, momentum = invariants(physics.advance(0, ()))
    for tick in range(1, 5001):
        truth = physics.advance(tick, ())
    energy_after, momentum_after = invariants(truth)
    assert energy_after == pytest.approx(energy, rel=1e-11)
    assert momentum_after == pytest.approx(momentum, abs=1e-10)


def test_products_of_inertia_in_contact_are_those_of_the_principal_axes() -> None:
    """A fall onto the skids with the same body written in its principal axes: same motion of every skid."""
    vehicle = load_vehicle("skywalker_x8").model_copy(update={"forces": (), "rotors": ()})
    moments, axes = np.linalg.eigh(vehicle.inertia_tensor_kgm2)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    spheres = {
        part: tuple(
            sphere.model_copy(update={"position_m": tuple((axes.T @ np.array(sphere.position_m)).tolist())})
            for sphere in getattr(vehicle, part)
        )
        for part in ("feet", "hull")
    }
    update = {"inertia_kgm2": tuple(moments.tolist()), "inertia_products_kgm2": (0.0, 0.0, 0.0)}
    principal = vehicle.model_copy(update=update | spheres)
    tracks = []
    for body, turn in ((vehicle, np.eye(3)), (principal, axes)):
        physics = VehiclePhysics(body, load_scene("airfield"), 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 0.25)))
        physics.state[3:7] = _quaternion(turn)
        physics.state[7:10], physics.state[10:13] = (1.0, 0.4, -1.0), turn.T @ np.array([0.8, -0.5, 0.3])
        track = []
        for tick in range(120):
            truth = physics.advance(tick, ())
            track.append([*truth.p_WB, *(turn @ np.array(truth.w_WB_B))])
        tracks.append(np.array(track))
        assert physics.touched
    assert tracks[0] == pytest.approx(tracks[1], abs=2e-6)


def _quaternion(R: np.ndarray) -> np.ndarray:
    w = 0.5 * math.sqrt(max(0.0, 1.0 + float(np.trace(R))))
    if w < 1e-3:
        _, vectors = np.linalg.eigh(0.5 * (R + np.eye(3)))
        return np.array([0.0, *vectors[:, -1]])
    return np.array([w, (R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drag": {"zero": 0.02, "alpha2": 1.0, "oswald_factor": 0.9}}, "two forms of the same drag"),
        ({"roll": {"beta": -0.1, "p": 0.2}}, "must be 0 or less"),
        ({"controls": {}}, "surface elevon_left moves elevator, and controls has none"),
    ],
)
def test_tables_that_cannot_be(change: dict[str, Any], message: str) -> None:
    fields = table_of(load_vehicle("skywalker_x8")).model_dump() | change
    with pytest.raises(ValueError, match=message):
        AeroTable.model_validate(fields)


def test_inertia_that_no_body_has_is_refused() -> None:
    """The first moments that were published of the X8."""
    fields = load_vehicle("skywalker_x8").model_dump()
    fields |= {"inertia_kgm2": (1.229, 0.1702, 0.8808), "inertia_products_kgm2": (0.0, -0.9343, 0.0)}
    with pytest.raises(ValueError, match=r"no moment of inertia|principal moments"):
        Vehicle.model_validate(fields)
