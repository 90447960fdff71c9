"""Planes that slide over the ground: Coulomb's friction against closed forms, and no energy out of a contact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS, TICK_S = 4_000_000, 0.004
X8 = load_vehicle("skywalker_x8")
MEADOW = load_scene("meadow")
IDLE = (0.0, 0.0, 0.0)


def touching_down(
    speed_mps: float, *, sink_mps: float, pitch_deg: float, seconds: float, drop_m: float = 0.05
) -> np.ndarray:
    """Return the states, [ticks, 13 + own], of the X8 from `drop_m` over its skids on."""
    height_m = X8.standing_height_m + drop_m + 0.28 * math.sin(math.radians(abs(pitch_deg)))
    physics = VehiclePhysics(X8, MEADOW, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, height_m)))
    half = 0.5 * math.radians(pitch_deg)
    physics.state[3:7] = (math.cos(half), 0.0, -math.sin(half), 0.0)
    physics.state[7:10] = (speed_mps, 0.0, -sink_mps)
    physics.advance(0, IDLE)
    states = []
    for tick in range(1, round(seconds / TICK_S) + 1):
        physics.advance(tick, IDLE)
        states.append(physics.state.copy())
    return np.array(states)


def pitch_deg(states: np.ndarray) -> np.ndarray:
    w, x, y, z = states[:, 3:7].T
    return np.degrees(np.arcsin(2.0 * (x * z - w * y)))


@pytest.mark.parametrize(
    ("speed_mps", "sink_mps", "pitch"), [(12.8, 1.1, 1.2), (11.5, 0.6, 8.0), (10.5, 0.3, 10.0), (13.0, 0.5, 5.0)]
)
def test_a_belly_landing_neither_bounces_nor_pitches_up(speed_mps: float, sink_mps: float, pitch: float) -> None:
    """Contact takes energy: no rise faster than the plane sank, and no nose higher than at touch-down."""
    states = touching_down(speed_mps, sink_mps=sink_mps, pitch_deg=pitch, seconds=4.0)
    down = int(np.argmax(states[:, 2] < X8.standing_height_m + 0.01))
    after = states[down:]
    assert after[:, 9].max() < 0.6 * sink_mps
    assert pitch_deg(after).max() < pitch + 3.0
    assert np.abs(after[-1, 7:13]).max() < 1e-3
    assert after[-1, 2] == pytest.approx(X8.standing_height_m, abs=1e-3)


def test_a_slow_slide_ends_after_v2_over_2_mu_g() -> None:
    """At 3 m/s lift and drag are 2 % of the weight."""
    states = touching_down(3.0, sink_mps=0.0, pitch_deg=0.0, seconds=3.0, drop_m=0.0)
    way = float(np.linalg.norm(states[-1, :2]))
    assert way == pytest.approx(3.0**2 / (2.0 * MEADOW.ground_friction * MEADOW.gravity_mps2), rel=0.03)


def test_friction_holds_a_plane_that_stands() -> None:
    physics = VehiclePhysics(X8, MEADOW, TICK_NS)
    physics.advance(0, IDLE)
    for tick in range(1, 251):
        physics.advance(tick, (0.4, 0.0, 0.0))  # 3.5 N of thrust against 13 N of friction
    assert float(np.linalg.norm(physics.state[:2])) < 1e-3
