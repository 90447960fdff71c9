"""Tilts: closed forms of axis, place, gyroscopic torque and flow at the hub; faults; what stands on its tail."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from pydantic import ValidationError

from sim.physics import fixed_wing, multirotor, vtol
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import TickSteps
from sim.physics.surface_faults import SurfaceFault
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle, rigid_body
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000
K, M, J = 8.54858e-06, 0.016, 2.649858234714004e-05  # of the x500


def tilting(model: str = "quadratic", **changes: Any) -> Vehicle:
    """Return an x500 whose front rotors tilt about a hinge below them."""
    data: dict[str, Any] = yaml.safe_load((VEHICLE_DIR / "x500.yaml").read_text())
    tilt = {"name": "front", "rotors": [0, 2], "hinge_m": [0.1, 0.0, 0.02], "max_deg": 90, "min_deg": -10}
    data["tilts"] = [tilt | {"rate_degps": 90.0, "time_constant_s": 0.05} | changes]
    data["rotor_model"] = model
    data["rotor_constants"]["drag_kg_per_rad"] = 0.0
    return Vehicle.model_validate(data)


def wrench(vehicle: Vehicle, controls: list[float], v: Any = (0, 0, 0), w: Any = (0, 0, 0)) -> NDArray[np.float64]:
    """Return force and torque with own states at rest, far from the ground."""
    forces = vehicle.make_forces(Effects(ground_effect=False, descent_loss=False))
    truth = np.zeros(13 + sum(force.states for force in forces) + 6)
    truth[2], truth[3] = 500.0, 1.0
    truth[7:10], truth[10:13] = v, w
    body = rigid_body(
        vehicle, truth, forces=forces, gravity_mps2=9.81, wind_W_mps=(0.0, 0.0, 0.0), steps=TickSteps(0.004, 1)
    )
    return np.array(body.steady_wrench(controls))


def physics_of(vehicle: Vehicle, *faults: SurfaceFault, z_m: float | None = 300.0) -> VehiclePhysics:
    start = FlightStart() if z_m is None else FlightStart(p_WB=(0.0, 0.0, z_m))
    scene = load_scene("airfield")
    return VehiclePhysics(vehicle, scene, TICK_NS, start=start, disturbances=Disturbances(faults=faults))


@pytest.mark.parametrize("angle_deg", [-10.0, 0.0, 35.0, 90.0])
def test_thrust_torque_and_place_follow_the_axis(angle_deg: float) -> None:
    vehicle = tilting()
    (tilt,) = vehicle.tilts
    t = math.radians(angle_deg)
    found = wrench(vehicle, [0.6, 0.0, 0.3, 0.0, tilt.command_of(t)])
    n = np.array([math.sin(t), 0.0, math.cos(t)])
    force, torque = np.zeros(3), np.zeros(3)
    for speed, y, spin in ((600.0, -0.174, 1.0), (300.0, 0.174, -1.0)):
        arm = np.array([0.174 - 0.1, 0.0, 0.058131 - 0.02])
        turned = np.array(
            [arm[0] * math.cos(t) + arm[2] * math.sin(t), 0.0, arm[2] * math.cos(t) - arm[0] * math.sin(t)]
        )
        place = np.array([0.1, y, 0.02]) + turned
        pull = K * speed**2 * n
        force += pull
        torque += np.cross(place, pull) - spin * M * K * speed**2 * n
    np.testing.assert_allclose(found[:3], force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[3:], torque, rtol=1e-12, atol=1e-12)


def test_a_turned_rotor_is_the_same_as_one_that_the_file_turns() -> None:
    vehicle = tilting("blade_element")
    (tilt,) = vehicle.tilts
    t = math.radians(50.0)
    rotors = tuple(tilt.turned(rotor, t) if i in (0, 2) else rotor for i, rotor in enumerate(vehicle.rotors))
    fixed = vehicle.model_copy(update={"tilts": (), "rotors": rotors})
    v, w = (7.0, -2.0, 1.0), (0.5, -1.0, 2.0)
    moved = wrench(vehicle, [0.6, 0.5, 0.55, 0.65, tilt.command_of(t)], v, w)
    np.testing.assert_allclose(moved, wrench(fixed, [0.6, 0.5, 0.55, 0.65], v, w), rtol=1e-11, atol=1e-11)


def test_angular_momentum_is_kept_while_rotors_tilt() -> None:
    """Without air: rotors coast in a vacuum, and body and spins together keep their angular momentum in W."""
    vehicle = tilting()
    constants = vehicle.rotor_constants.model_copy(
        update={"thrust_coefficient_n_per_radps2": 1e-30, "time_constant_down_s": 1.0, "time_constant_up_s": 1.0}
    )
    none = (0.0, 0.0, 0.0)
    still = {"body_drag_linear_n_per_mps": none, "body_drag_quadratic_n_per_m2ps2": none}
    vehicle = vehicle.model_copy(update={"rotor_constants": constants, **still})
    physics = physics_of(vehicle, z_m=2000.0)
    physics.state[10:13] = (0.3, -0.2, 0.1)
    physics.state[13:17] = (900.0, 400.0, 500.0, 800.0)

    def momentum() -> NDArray[np.float64]:
        w, x, y, z = physics.state[3:7]
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        t = physics.state[17]
        axes = [(math.sin(t), 0.0, math.cos(t)) if i in (0, 2) else (0.0, 0.0, 1.0) for i in range(4)]
        spins = [rotor.spin.sign for rotor in vehicle.rotors]
        h = sum(J * s * speed * np.array(n) for s, speed, n in zip(spins, physics.state[13:17], axes, strict=True))
        return np.asarray(R @ (np.array(vehicle.inertia_kgm2) * physics.state[10:13] + h))

    physics.advance(0, vehicle.rest_commands)
    before, rates = momentum(), []
    for tick in range(1, 300):
        physics.advance(tick, (0.0, 0.0, 0.0, 0.0, 1.0 if tick < 150 else -0.5))
        rates.append(physics.state[10])
    np.testing.assert_allclose(momentum(), before, rtol=0.0, atol=1e-10)
    assert max(rates) - min(rates) > 0.1  # the body has turned against the spins, from z ahead to x


def test_hubs_that_swing_meet_the_air() -> None:
    """A rotor on a long arm that swings up at 1.57 rad/s climbs at 0.8 m/s, and blade elements lose thrust."""
    vehicle = tilting(
        "blade_element", hinge_m=[-0.35, 0.0, 0.058131], max_deg=0.0, min_deg=-90.0, time_constant_s=0.001
    )
    slow = vehicle.model_copy(update={"tilts": (vehicle.tilts[0].model_copy(update={"rate_degps": 1e-3}),)})
    heavy = {"mass_kg": 500.0, "inertia_kgm2": (50.0, 50.0, 50.0)}
    lifts = []
    for of in (vehicle, slow):
        physics = physics_of(of.model_copy(update=heavy))
        physics.state[13:17] = 600.0
        physics.advance(0, (0.6, 0.6, 0.6, 0.6, 1.0))
        truth = physics.advance(1, (0.6, 0.6, 0.6, 0.6, -1.0))
        lifts.append((truth.a_WB_W[2] + physics.scene.gravity_mps2) * 500.0)
    c = vehicle.rotor_constants
    assert c.blade_element is not None
    swinging, still = lifts
    assert 0.90 < swinging / still < 0.995


def test_a_tick_costs_nothing_without_tilts() -> None:
    forces = load_vehicle("x500").make_forces(Effects())
    assert [type(force).__name__ for force in forces] == ["AirDrag", "BladeRotors"]


def test_commands_and_truth_stand_after_the_rotors() -> None:
    vehicle = load_vehicle("tiltrotor")
    names = [command.name for command in vehicle.commands]
    assert names == [*(f"rotor_{i}" for i in range(4)), "tilt_right", "tilt_left", "elevon_left", "elevon_right"]
    assert vehicle.signed_commands == frozenset({4, 5, 6, 7})
    assert vehicle.rest_commands == (0, 0, 0, 0, -1, -1, 0, 0)
    assert vehicle.ahead_commands == (0, 0, 0, 0, 1, 1, 0, 0)
    physics = physics_of(vehicle)
    for tick in range(500):
        truth = physics.advance(tick, (0.5, 0.5, 0.5, 0.5, 0.0, 1.0, 0.5, -0.5))
    np.testing.assert_allclose(np.degrees(truth.surface_rad), (45.0, 90.0, 15.0, -15.0), atol=1e-6)


@pytest.mark.parametrize(
    ("fault", "right_deg"),
    [
        (SurfaceFault(kind="stuck", surface="tilt_right", at_s=0.4, angle_deg=20.0), 20.0),
        (SurfaceFault(kind="floating", surface="tilt_right", at_s=0.4), 0.0),
        (SurfaceFault(kind="lost", surface="tilt_right", at_s=0.4), 90.0),
    ],
)
def test_faults_of_a_tilt(fault: SurfaceFault, right_deg: float) -> None:
    physics = physics_of(load_vehicle("tiltrotor"), fault)
    for tick in range(500):
        truth = physics.advance(tick, (0.5, 0.5, 0.5, 0.5, 1.0, 1.0, 0.0, 0.0))
    assert math.degrees(truth.surface_rad[0]) == pytest.approx(right_deg, abs=1e-6)
    assert math.degrees(truth.surface_rad[1]) == pytest.approx(90.0, abs=1e-6)
    assert (truth.rotor_speed_radps[0] < 1.0) == (fault.kind == "lost")
    assert truth.rotor_speed_radps[2] > 740.0
    assert [event.kind for event in physics.take_events()] == ["fault"]
    assert physics.restart(1).surface_rad[0] == 0.0
    for tick in range(1, 500):
        truth = physics.advance(tick, (0.5, 0.5, 0.5, 0.5, 1.0, 1.0, 0.0, 0.0)) if tick < 90 else truth
    assert truth.rotor_speed_radps[0] > 740.0  # repaired


def test_the_battery_feels_the_moved_axis_of_a_placed_vehicle() -> None:
    """A placed vehicle has the bits of a new one, whatever its tilts did before."""
    vehicle = load_vehicle("tiltrotor")
    scene, start = load_scene("airfield"), FlightStart(p_WB=(0.0, 0.0, 300.0))
    flown, new = (VehiclePhysics(vehicle, scene, TICK_NS, start=start, effects=Effects(battery=True)) for _ in range(2))
    for tick in range(200):
        flown.advance(tick, (0.5, 0.5, 0.5, 0.5, 1.0, 1.0, 0.0, 0.0))
    new.advance(0, vehicle.rest_commands)
    flown.reset()
    speeds = (700.0,) * 4
    for physics in (flown, new):
        physics.place((0.0, 0.0, 300.0), v_WB_W=(12.0, 0.0, 0.0), rotor_speed_radps=speeds)
    commands = (0.5, 0.5, 0.5, 0.5, 0.3, 0.2, 0.0, 0.0)
    a = [flown.advance(200 + k, commands) for k in range(20)]
    b = [new.advance(1 + k, commands) for k in range(20)]
    assert [truth[2:] for truth in a] == [truth[2:] for truth in b]


def test_a_tailsitter_stands_on_its_tail() -> None:
    vehicle = load_vehicle("tailsitter")
    assert vehicle.standing_height_m == pytest.approx(0.32)
    physics = physics_of(vehicle, z_m=None)
    for tick in range(500):
        truth = physics.advance(tick, vehicle.rest_commands)
    w, x, y, z = truth.q_WB
    assert 2.0 * (x * z - w * y) == pytest.approx(1.0, abs=1e-6)  # the nose points up
    assert truth.in_contact
    assert np.linalg.norm(truth.p_WB[:2]) < 1e-4


def test_a_tailsitter_hovers_with_its_nose_up() -> None:
    vehicle = load_vehicle("tailsitter")
    hover = vtol.hovering(vehicle)
    assert multirotor.unfit(hover) is None
    assert vtol.is_vtol(vehicle)
    assert not fixed_wing.is_plane(vehicle)
    assert hover.inertia_kgm2 == vehicle.inertia_kgm2[::-1]
    assert [rotor.axis for rotor in hover.rotors] == [(0.0, 0.0, 1.0)] * 4
    control = multirotor.hover_control(vehicle)
    assert control == pytest.approx(multirotor.hover_control(hover))
    physics = physics_of(vehicle)
    control = multirotor.hover_control(vehicle, physics.density_ratio)
    physics.state[13:17] = control * vehicle.rotor_constants.max_speed_radps
    truth = physics.advance(0, vehicle.rest_commands)
    for tick in range(1, 20):
        truth = physics.advance(tick, (control,) * 4 + (0.0, 0.0))
    assert abs(truth.a_WB_W[2]) < 0.2  # the weight is carried; the wash drags a little on the fuselage


def test_a_tiltrotor_has_its_engines_in_flight() -> None:
    vehicle = load_vehicle("tiltrotor")
    assert vtol.lifters(vehicle) == [0, 1, 2, 3]
    assert fixed_wing.engines(vehicle) == [0, 2]
    assert vtol.pushers(vehicle) == []
    assert [vehicle.rotors_ahead[i].axis[0] for i in (0, 2)] == pytest.approx([1.0, 1.0])
    assert fixed_wing.unfit(vehicle) is None  # its tilts, before the surfaces, are no wheels
    assert multirotor.unfit(vehicle) is not None  # a multirotor's controller would not move its tilts
    assert multirotor.unfit(vtol.hovering(vehicle)) is None
    airframe = fixed_wing.Airframe(vehicle)
    trim = airframe.trim(airframe.cruise_mps)
    assert trim.controls[4:6] == (1.0, 1.0)
    assert trim.controls[1] == trim.controls[3] == 0.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"min_deg": 10.0}, "the angle 0, at which the rotors are as the file has them"),
        ({"rotors": [4]}, "tilt front has rotor 4, and the vehicle has rotors 0 to 3"),
        ({"rotors": [0, 0]}, "rotor 0 is on the tilts front and front"),
        ({"axis": [0, 0, 0]}, "has no direction"),
    ],
)
def test_tilts_that_cannot_be(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        tilting(**change)


def test_a_coaxial_pair_tilts_together() -> None:
    data: dict[str, Any] = yaml.safe_load((VEHICLE_DIR / "y6.yaml").read_text())
    upper = next(rotor["coaxial_below"] for rotor in data["rotors"] if rotor.get("coaxial_below") is not None)
    data["tilts"] = [{"name": "one", "rotors": [upper], "max_deg": 30, "min_deg": -30, "time_constant_s": 0.05}]
    with pytest.raises(ValidationError, match="both must be on the same tilt"):
        Vehicle.model_validate(data)
