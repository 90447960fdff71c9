"""The offboard pilot flies the mock by every kind of set-point; the flight is compared with the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from signals._kernel import tangent_ned
from signals.desired import DesiredState
from signals.geodesy import LocalFrame
from signals.samples import TruthState
from sim.scene.scene import load_scene
from tests.worlds.mock_pixhawk_world import TICK_HZ, TICK_NS, World

WANTED_EVERY = 10  # ticks: a companion at 25 Hz
UP = DesiredState(p_W=(0.0, 0.0, 3.0), yaw_rad=0.0)


class Flight:
    """The mock's world and its pilot, with the messages sent and received."""

    def __init__(self, *, seed: int = 1, autopilot: dict[str, Any] | None = None, **settings: Any) -> None:
        self.world = World(seed=seed, **(autopilot or {}))
        self.events: list[tuple[int, str, str]] = []
        geodesy = LocalFrame(load_scene("airfield").site)
        self.pilot = OffboardPilot(
            geodesy.geodetic_from_enu,
            tick_ns=TICK_NS,
            projection=tangent_ned,
            on_event=lambda *event: self.events.append(event),
            **settings,
        )
        self.sent: list[bytes] = []
        self.world.extra = self._extra

    def _extra(self, t_ns: int, frames: Any) -> bytes:
        self.sent.append(self.pilot.step(t_ns, frames))
        return self.sent[-1]

    @property
    def truth(self) -> TruthState:
        return self.world.truth

    def fly(self, seconds: float, wanted: DesiredState | Callable[[float], DesiredState] | None) -> list[TruthState]:
        """Return the truth at every tick; `wanted` may depend on the time since the call [s]."""
        seen = []
        for i in range(round(seconds * TICK_HZ)):
            if wanted is not None and i % WANTED_EVERY == 0:
                desired = wanted(i / TICK_HZ) if callable(wanted) else wanted
                self.pilot.set_desired(desired, self.world.tick * TICK_NS)
            self.world.step()
            seen.append(self.truth)
        return seen

    def take_off(self) -> None:
        self.fly(5.0, None)
        self.fly(10.0, UP)
        assert math.dist(self.truth.p_WB, (0.0, 0.0, 3.0)) < 0.2

    def land(self) -> None:
        for _ in range(60):
            self.fly(0.5, DesiredState(land=True))
            if self.pilot.phase is Phase.DONE:
                return
        raise AssertionError(f"still {self.pilot.phase}")


def yaw_of(truth: TruthState) -> float:
    w, x, y, z = truth.q_WB
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tour(seed: int) -> tuple[list[bytes], list[TruthState], Flight]:
    """Up to 3 m, a square, velocities, an attitude, and down."""
    flight = Flight(seed=seed)
    flight.take_off()
    seen: list[TruthState] = []
    for corner in ((5.0, 0.0, 3.0), (5.0, 5.0, 3.0), (0.0, 5.0, 3.0), (0.0, 0.0, 3.0)):
        seen += flight.fly(7.0, DesiredState(p_W=corner, yaw_rad=0.8))
        assert math.dist(flight.truth.p_WB, corner) < 0.2, corner
        assert abs(yaw_of(flight.truth) - 0.8) < 0.05
    seen += flight.fly(4.0, DesiredState(v_W=(1.5, -1.0, 0.5), yaw_rate_radps=0.2))
    assert math.dist(flight.truth.v_WB_W, (1.5, -1.0, 0.5)) < 0.2
    assert flight.truth.w_WB_B[2] == pytest.approx(0.2, abs=0.05)
    seen += flight.fly(3.0, DesiredState(v_W=(0.0, 0.0, 0.0)))

    q_WB = (math.cos(0.3), 0.0, 0.0, math.sin(0.3))

    def hover(_t_s: float) -> DesiredState:
        """Hold the height by thrust, as a companion."""
        z, vz = flight.truth.p_WB[2], flight.truth.v_WB_W[2]
        return DesiredState(q_WB=q_WB, thrust=min(max(0.62 + 0.06 * (4.0 - z) - 0.08 * vz, 0.0), 1.0))

    hovering = flight.fly(5.0, hover)
    seen += hovering
    assert abs(yaw_of(flight.truth) - 0.6) < 0.03
    assert max(math.hypot(s.q_WB[1], s.q_WB[2]) for s in hovering[500:]) < 0.02  # level: half the tilt
    assert abs(flight.truth.p_WB[2] - 4.0) < 1.0
    assert abs(flight.truth.v_WB_W[2]) < 0.3
    flight.land()
    return flight.sent, seen, flight


def test_a_flight_by_every_kind_of_set_point_repeats_exactly() -> None:
    sent, seen, flight = tour(1)
    assert not flight.pilot.armed
    assert flight.events == []
    again, seen_again, _ = tour(1)
    assert sent == again
    assert seen == seen_again
    # In flight only set-points and heartbeats are sent: 50 a second.
    in_air = sent[15 * TICK_HZ : 25 * TICK_HZ]
    assert sum(bool(data) for data in in_air) in range(500, 511)


def test_a_path_with_velocity_and_acceleration_is_followed_closely() -> None:
    flight = Flight()
    flight.take_off()
    radius_m, rate_radps = 3.0, 0.5

    def circle(t_s: float) -> DesiredState:
        a = rate_radps * t_s
        c, s, v = math.cos(a), math.sin(a), radius_m * rate_radps
        return DesiredState(
            p_W=(radius_m * s, radius_m * (1.0 - c), 3.0),
            v_W=(v * c, v * s, 0.0),
            a_W=(-v * rate_radps * s, v * rate_radps * c, 0.0),
            yaw_rad=a,
        )

    seen = flight.fly(12.0, circle)[1000:]
    errors = [math.hypot(s.p_WB[0], s.p_WB[1] - radius_m) - radius_m for s in seen]
    assert np.abs(errors).max() < 0.5
    flight.land()
