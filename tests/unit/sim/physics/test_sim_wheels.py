"""Wheels against closed forms: rest, strut, rolling distance, braking, bicycle model, side slip, touch-down."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sim.physics.flight_start import FlightStart
from sim.physics.integration import Integration
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

SCENE = load_scene("airfield")
G = SCENE.gravity_mps2
TICK_NS = 4_000_000
DT = TICK_NS * 1e-9
MASS = 4.0
# Nose wheel 0.6 m ahead, main wheels 0.2 m behind: loads 1/4 and 3/8 each.
AHEAD, BEHIND, TRACK, LOW = 0.6, 0.2, 0.3, 0.25
WHEEL: dict[str, Any] = {"radius_m": 0.05, "damping_nspm": 60.0, "rolling": 0.03}


def vehicle(**changes: Any) -> Vehicle:
    """A cart without aerodynamic drag, whose contact spheres are well above the ground."""
    every: dict[str, Any] = changes.pop("wheel", {})
    places = {"nose": (AHEAD, 0.0, 1000.0), "left": (-BEHIND, TRACK, 1500.0), "right": (-BEHIND, -TRACK, 1500.0)}
    wheels = [
        {"name": name, "position_m": (x, y, -LOW), "stiffness_npm": k, "steers": 1.0 if name == "nose" else 0.0}
        | {"brakes": 0.0 if name == "nose" else 1.0}
        | WHEEL
        | every
        for name, (x, y, k) in places.items()
    ]
    steering = {"max_deg": 30, "min_deg": -30, "time_constant_s": 0.02}
    content: dict[str, Any] = {
        "name": "cart",
        "description": "cart",
        "mass_kg": MASS,
        "inertia_kgm2": (0.15, 0.25, 0.35),
        "body_drag_linear_n_per_mps": (0.0, 0.0, 0.0),
        "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        "feet": [
            {"name": f"hull_{i}", "position_m": (x, y, 0.0), "radius_m": 0.05}
            for i, (x, y) in enumerate(((0.3, 0.0), (-0.2, 0.1), (-0.2, -0.1)))
        ],
        "forces": [{"kind": "wheels", "wheels": wheels, "steering": steering}],
    }
    return Vehicle.model_validate(content | changes)


def pushed(force_W_n: tuple[float, float, float], **changes: Any) -> Vehicle:
    """The cart with a constant force in W."""
    model, push = vehicle(**changes), vehicle(forces=[{"kind": "push", "force_W_n": force_W_n}])
    return model.model_copy(update={"forces": (*model.forces, *push.forces)})


def standing(model: Vehicle | None = None, **more: Any) -> VehiclePhysics:
    return VehiclePhysics(model or vehicle(), SCENE, TICK_NS, **more)


def rolling(speed_mps: float, model: Vehicle | None = None, sideways_mps: float = 0.0) -> VehiclePhysics:
    physics = standing(model)
    physics.state[7:10] = (speed_mps, sideways_mps, 0.0)
    return physics


def test_it_stands_with_the_loads_of_its_lever_arms_and_neither_creeps_nor_rings() -> None:
    physics = standing()
    truth = physics.advance(0, ())
    start = truth.p_WB
    for tick in range(1, 2500):
        truth = physics.advance(tick, (0.0, 0.0))
    loads = physics._wheels[0].loads_n
    weight = MASS * G
    share = BEHIND / (AHEAD + BEHIND)
    assert loads == pytest.approx([weight * share, weight * (1 - share) / 2, weight * (1 - share) / 2], rel=1e-3)
    assert np.linalg.norm(np.subtract(truth.p_WB, start)) < 2e-4  # 10 s later
    assert np.linalg.norm(truth.v_WB_W) < 1e-6
    assert np.linalg.norm(truth.w_WB_B) < 1e-6
    assert truth.in_contact


def test_a_side_push_is_held_by_static_friction() -> None:
    """Gravity along a slope of 2 degrees, as a push: it leans on its tyres, and stays."""
    force = MASS * G * math.sin(math.radians(2.0))
    physics = standing(pushed((0.0, force, 0.0)))
    for tick in range(2000):
        truth = physics.advance(tick, (0.0, 0.0))
    early = truth.p_WB[1]
    for tick in range(2000, 4500):
        truth = physics.advance(tick, (0.0, 0.0))
    assert abs(truth.p_WB[1] - early) < 1e-6
    patches = force / (0.8 * MASS * G / 5e-3)  # over the stiffness mu N / z_m of all
    height = truth.p_WB[2]
    roll = force * height / (2 * 1500.0 * TRACK**2)
    assert truth.p_WB[1] == pytest.approx(patches + roll * height, rel=0.1)


def test_small_oscillations_of_the_struts_are_those_of_a_damped_spring() -> None:
    """All struts alike under the centre of mass: heave has w^2 = k / m and 2 zeta w = c / m."""
    wheels = [
        {"name": f"w{i}", "position_m": (x, y, -LOW), "radius_m": 0.05, "stiffness_npm": 800.0, "damping_nspm": 8.0}
        for i, (x, y) in enumerate(((0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)))
    ]
    physics = standing(vehicle(forces=[{"kind": "wheels", "wheels": wheels}]))
    physics.advance(0, ())
    rest = float(physics.state[2])
    physics.state[9] = 0.05
    k, c = 3200.0, 32.0
    w0, damping = math.sqrt(k / MASS), c / (2.0 * MASS)
    w = math.sqrt(w0 * w0 - damping * damping)
    worst = 0.0
    for tick in range(1, 250):
        z = physics.advance(tick, ()).p_WB[2] - rest
        t = tick * DT
        worst = max(worst, abs(z - 0.05 / w * math.exp(-damping * t) * math.sin(w * t)))
    assert worst < 2e-6  # of 1.8 mm


def test_rolling_stops_after_the_distance_of_rolling_friction() -> None:
    for speed in (3.0, 6.0):
        physics = rolling(speed)
        tick = 0
        truth = physics.advance(0, ())
        start = truth.p_WB[0]
        while truth.v_WB_W[0] > 0.0 and tick < 20_000:
            tick += 1
            truth = physics.advance(tick, (0.0, 0.0))
        expected = speed * speed / (2.0 * 0.03 * G)
        assert truth.p_WB[0] - start == pytest.approx(expected, rel=2e-3, abs=5e-3)
        assert tick * DT == pytest.approx(speed / (0.03 * G), rel=1e-2)
        assert abs(truth.p_WB[1]) < 1e-6


def test_brakes_stop_it_by_the_friction_of_the_braked_wheels() -> None:
    physics = rolling(8.0)
    truth = physics.advance(0, ())
    start, tick = truth.p_WB[0], 0
    while truth.v_WB_W[0] > 0.0 and tick < 5000:
        tick += 1
        truth = physics.advance(tick, (0.0, 0.3))
    # Load moves to the nose wheel, which has no brake: a = g (c_rr + b (1 - n)), n its share with the moment a h.
    h = LOW + 0.05 - 0.01
    b, r, base = 0.3, 0.03, AHEAD + BEHIND
    a = G * (r + b * (1.0 - BEHIND / base)) / (1.0 + b * h / base)
    assert truth.p_WB[0] - start == pytest.approx(64.0 / (2.0 * a), rel=0.02)


@pytest.mark.parametrize("command", [0.4, -0.4])
def test_steering_turns_with_the_radius_of_the_bicycle_model(command: float) -> None:
    model = vehicle(wheel={"rolling": 0.0, "cornering_per_rad": 60.0})
    physics = rolling(1.0, model)
    places = []
    for tick in range(5000):
        truth = physics.advance(tick, (command, 0.0))
        if tick > 500:
            places.append(truth.p_WB[:2])
    xy = np.array(places)
    fit = np.linalg.lstsq(np.c_[2 * xy, np.ones(len(xy))], (xy**2).sum(1), rcond=None)[0]
    radius = math.sqrt(fit[2] + fit[0] ** 2 + fit[1] ** 2)
    angle = math.radians(30.0 * abs(command))
    rear = (AHEAD + BEHIND) / math.tan(angle)
    assert radius == pytest.approx(math.hypot(rear, BEHIND), rel=0.02)
    assert math.copysign(1.0, truth.w_WB_B[2]) == math.copysign(1.0, command)  # +1: to the left


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5])
def test_a_steady_side_force_needs_the_slip_angle_of_the_curve(share: float) -> None:
    """F / N = mu q / (1 + q), q = C tan(slip) / mu, for a cart that a push drives sideways and that cannot turn."""
    physics = rolling(5.0, pushed((0.0, share * MASS * G, 0.0), inertia_kgm2=(100.0,) * 3, wheel={"rolling": 0.0}))
    for tick in range(1500):  # it settles with the time v_x (1 + q)^2 / (C g): 0.45 s at the greatest
        v = physics.advance(tick, (0.0, 0.0)).v_WB_W
    q = 8.0 * v[1] / v[0] / 0.8
    assert 0.8 * q / (1.0 + q) == pytest.approx(share, rel=0.012)  # it rolls slowly on its struts


def test_sliding_sideways_decelerates_by_friction() -> None:
    physics = rolling(0.0, vehicle(inertia_kgm2=(100.0,) * 3), 6.0)
    for tick in range(25):
        truth = physics.advance(tick, (0.0, 0.0))
    assert truth.a_WB_W[1] == pytest.approx(-0.8 * G, rel=0.01)


def test_full_brakes_and_a_slip_stay_in_the_friction_circle() -> None:
    model = vehicle(inertia_kgm2=(100.0, 100.0, 100.0), wheel={"brakes": 2.0})
    physics = rolling(8.0, model, 6.0)
    for tick in range(20):
        truth = physics.advance(tick, (0.0, 1.0))
    ax, ay, _ = truth.a_WB_W
    assert math.hypot(ax, ay) == pytest.approx(0.8 * G, rel=0.01)
    assert ax < 0.0
    assert ay < 0.0


def test_a_touch_down_bounces_settles_and_loses_no_wheel() -> None:
    model = vehicle()
    physics = VehiclePhysics(model, SCENE, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, model.standing_height_m + 0.2)))
    physics.state[7:10] = (12.0, 0.0, -1.0)
    seen = False
    for tick in range(1500):
        truth = physics.advance(tick, (0.0, 0.0))
        seen = seen or truth.in_contact
        assert truth.p_WB[2] > 0.05  # the hull never reaches the ground
    assert seen
    assert truth.in_contact
    assert abs(truth.v_WB_W[2]) < 1e-3
    assert truth.p_WB[2] == pytest.approx(model.standing_height_m, abs=5e-3)


def test_touch_down_does_not_depend_on_the_length_of_the_steps() -> None:
    model = vehicle()
    ends = []
    for step_ns in (4_000_000, 1_000_000, 250_000):
        start = FlightStart(p_WB=(0.0, 0.0, model.standing_height_m + 0.1))
        physics = VehiclePhysics(model, SCENE, TICK_NS, start=start, integration=Integration(step_ns=step_ns))
        physics.state[7:10] = (10.0, 0.5, -0.5)
        for tick in range(500):
            truth = physics.advance(tick, (0.2, 0.1))
        ends.append(np.array(truth.p_WB))
    assert np.linalg.norm(ends[0] - ends[2]) < 2e-3  # of 18 m
    assert np.linalg.norm(ends[1] - ends[2]) < 1e-3


def test_far_above_the_ground_wheels_change_nothing() -> None:
    start = FlightStart(p_WB=(0.0, 0.0, 50.0))
    with_wheels = VehiclePhysics(vehicle(), SCENE, TICK_NS, start=start)
    bare = VehiclePhysics(vehicle(forces=[]), SCENE, TICK_NS, start=start)
    for tick in range(300):
        a, b = with_wheels.advance(tick, (0.5, 0.0)), bare.advance(tick, ())
        assert a.p_WB == b.p_WB
        assert a.v_WB_W == b.v_WB_W
        assert not a.in_contact


def test_settings_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="steering needs a wheel that steers"):
        vehicle(wheel={"steers": 0.0})
    with pytest.raises(ValueError, match="castering does not steer"):
        vehicle(wheel={"castering": True, "steers": 0.5})
    names = [command.name for command in vehicle().commands]
    assert names == ["steering", "brake"]


def test_a_taildragger_stands_at_the_pitch_of_its_loads() -> None:
    """The physics settles by itself where the moments of the loads are in balance."""
    trainer = load_vehicle("trainer")
    physics = VehiclePhysics(trainer, SCENE, TICK_NS)
    for tick in range(250):
        truth = physics.advance(tick, (0.0,) * len(trainer.commands))
    w, x, y, z = truth.q_WB
    pitch = math.asin(2.0 * (z * x - w * y))
    assert pitch == pytest.approx(trainer.standing_pitch_rad, abs=2e-5)
    assert math.degrees(pitch) == pytest.approx(11.4, abs=0.1)
    assert trainer.rolling_resistance == 0.02


def test_a_tail_wheel_turns_the_nose_to_the_side_of_its_command() -> None:
    trainer = load_vehicle("trainer")
    physics = VehiclePhysics(trainer, SCENE, TICK_NS)
    physics.advance(0, (0.0,) * len(trainer.commands))
    physics.state[7:10] = (2.0, 0.0, 0.0)
    steering = [c.name for c in trainer.commands].index("steering")
    commands = tuple(0.3 if i == steering else 0.0 for i in range(len(trainer.commands)))
    for tick in range(1, 100):
        truth = physics.advance(tick, commands)
    assert truth.w_WB_B[2] > 0.2  # to the left
