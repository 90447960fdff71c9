"""A plane on a runway: take-off roll, landing with brakes, a landing on its belly, and a catapult launch."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from signals.samples import TruthState
from sim.physics.flight_start import FlightStart
from sim.physics.forces.wheels import Wheels
from sim.physics.launch import Catapult
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

SCENE = load_scene("airstrip")
TICK_NS = 4_000_000
DT = TICK_NS * 1e-9


def wheel(name: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    tyre = {"stiffness_npm": 6000.0, "damping_nspm": 170.0} if y else {"stiffness_npm": 3000.0, "damping_nspm": 90.0}
    return {"name": name, "position_m": (x, y, -0.38), "radius_m": 0.07, **tyre, **more}


def on_wheels() -> Vehicle:
    """The Aerosonde with a nose-wheel gear of invented numbers; it has none in its book."""
    gear = {
        "kind": "wheels",
        "steering": {"max_deg": 15, "min_deg": -15},
        "wheels": [
            wheel("nose", 0.6, 0.0, steers=1.0),
            wheel("left", -0.12, 0.35, brakes=0.4),
            wheel("right", -0.12, -0.35, brakes=0.4),
        ],
    }
    plane = load_vehicle("aerosonde")
    return plane.model_copy(update={"forces": (*plane.forces, Wheels.model_validate(gear))})


def angles(t: TruthState) -> tuple[float, float, float]:
    """Roll, pitch (nose up above 0), yaw [rad]."""
    w, x, y, z = t.q_WB
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return roll, math.asin(2 * (z * x - w * y)), math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def flown(
    physics: VehiclePhysics, seconds: float, *, throttle: Callable[[float], float], pitch_rad: float, brake: float
) -> list[TruthState]:
    """Fly with a controller of attitude and, on the ground, of the heading. Commands: `Vehicle.commands`."""
    t = physics.advance(0, ())
    truths = [t]
    for tick in range(1, round(seconds / DT)):
        roll, pitch, yaw = angles(t)
        aileron = -1.0 * roll - 0.2 * t.w_WB_B[0]
        elevator = 1.5 * (pitch - pitch_rad) - 0.35 if t.v_WB_W[0] > 16.0 else 0.0
        steering = -4.0 * yaw - 0.2 * t.p_WB[1] - 1.0 * t.w_WB_B[2]
        brakes = brake if t.in_contact else 0.0
        t = physics.advance(tick, (throttle(tick * DT), aileron, elevator, 0.0, steering, brakes))
        truths.append(t)
    return truths


def test_a_take_off_roll_is_straight_and_ends_in_the_air() -> None:
    assert [c.name for c in on_wheels().commands] == ["rotor_0", "aileron", "elevator", "rudder", "steering", "brake"]
    physics = VehiclePhysics(on_wheels(), SCENE, TICK_NS)
    truths = flown(physics, 8.0, throttle=lambda t: 1.0 if t > 1.0 else 0.0, pitch_rad=0.1, brake=0.0)
    still = truths[round(0.9 / DT)]
    assert np.linalg.norm(still.v_WB_W) < 1e-5
    off = next(t for t in truths if t.t_ns > 1e9 and not t.in_contact)
    assert SCENE.runway is not None
    assert SCENE.runway.contains(off.p_WB)
    assert abs(off.p_WB[1]) < 0.5
    assert off.v_WB_W[0] > 20.0
    assert truths[-1].p_WB[2] > 5.0


@pytest.mark.parametrize("brake", [0.0, 0.8])
def test_a_landing_settles_on_the_wheels_and_brakes_shorten_it(brake: float) -> None:
    start = FlightStart(p_WB=(0.0, 0.5, on_wheels().standing_height_m + 0.6))
    physics = VehiclePhysics(on_wheels(), SCENE, TICK_NS, start=start)
    physics.state[7:10] = (24.0, 0.3, -0.8)
    truths = flown(physics, 12.0, throttle=lambda t: 0.0, pitch_rad=0.02, brake=brake)
    hull = [t.p_WB[2] for t in truths]
    assert min(hull) > 0.32  # the skids end at 0.30 m
    last = truths[-1]
    assert last.in_contact
    assert abs(last.p_WB[1]) < 1.5
    assert max(abs(angle) for angle in angles(last)[:2]) < 0.05
    if brake:
        assert np.linalg.norm(last.v_WB_W) < 1e-3
        assert last.p_WB[0] < 160.0
    else:
        assert 5.0 < last.v_WB_W[0] < 24.0


def test_without_wheels_it_slides_on_its_belly_and_stops() -> None:
    plane = load_vehicle("aerosonde")
    start = FlightStart(p_WB=(0.0, 0.0, plane.standing_height_m + 0.3))
    physics = VehiclePhysics(plane, SCENE, TICK_NS, start=start)
    physics.state[7:10] = (15.0, 0.0, -0.5)
    for tick in range(1500):
        truth = physics.advance(tick, (0.0, 0.0, 0.0, 0.0))
    assert truth.in_contact
    assert np.linalg.norm(truth.v_WB_W) < 0.05
    assert 8.0 < truth.p_WB[0] < 30.0  # v^2 / (2 mu g) is 14 m


def test_a_catapult_launch_ends_in_flight() -> None:
    plane = load_vehicle("aerosonde")
    launch = Catapult(kind="catapult", length_m=6.0, speed_mps=26.0, elevation_deg=8.0, throttle=0.7, delay_s=0.2)
    physics = VehiclePhysics(plane, SCENE, TICK_NS, start=FlightStart(launch=launch))
    truths = flown(physics, 6.0, throttle=lambda t: 0.8 if t > 0.5 else 0.0, pitch_rad=0.12, brake=0.0)
    texts = [event.text for event in physics.take_events()]
    assert len(texts) == 2
    assert "released" in texts[1]
    k = next(k for k, t in enumerate(truths) if t.v_WB_W[0] > 1.0)
    assert k * DT == pytest.approx(0.7, abs=0.1)
    released = next(t for t in truths if t.t_ns > k * TICK_NS and not t.in_contact)
    assert released.v_WB_W[0] > 26.0  # thrust helps
    assert all(not t.in_contact and t.p_WB[2] > 1.0 for t in truths if t.t_ns > released.t_ns)
    assert truths[-1].p_WB[2] > 10.0
