"""A vehicle put back to its start while the bench's time goes on."""

from __future__ import annotations

from typing import Any

import pytest

from hil.run.loop.restartable_physics import RestartablePhysics
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Wind

TICK_NS = 4_000_000
FULL = (0.85,) * 4


def restartable(**settings: Any) -> RestartablePhysics:
    vehicle, scene = load_vehicle("x500"), load_scene("airfield")
    return RestartablePhysics(lambda: VehiclePhysics(vehicle, scene, TICK_NS, **settings), tick_ns=TICK_NS)


def fly(physics: RestartablePhysics, ticks: range) -> list[Any]:
    return [physics.advance(tick, FULL) for tick in ticks]


def moved(track: list[Any], ticks: int) -> list[Any]:
    """Return the same states, so many ticks later."""
    return [t._replace(tick=t.tick + ticks, t_ns=t.t_ns + ticks * TICK_NS) for t in track]


def test_without_a_restart_it_is_the_vehicle_itself() -> None:
    physics, plain = restartable(), restartable()._physics
    assert fly(physics, range(100)) == [plain.advance(tick, FULL) for tick in range(100)]
    assert physics.vehicle is physics._physics.vehicle
    assert physics.state is not None
    with pytest.raises(AttributeError):
        _ = physics.nonsense


def test_after_a_restart_the_same_flight_happens_at_later_times() -> None:
    physics = restartable()
    first = fly(physics, range(150))
    assert first[-1].p_WB[2] > 0.3
    physics.restart()
    again = fly(physics, range(200, 350))  # the ticks between were the reboot's
    assert again == moved(first, 200)
    physics.restart()
    assert fly(physics, range(350, 450)) == moved(first[:100], 350)


def test_faults_and_gusts_happen_again_at_the_bench_s_time() -> None:
    gust = GustEvent(at_s=0.06, velocity_W_mps=(3.0, 0.0, 0.0), rise_s=1.0)
    fault = RotorFault(kind="efficiency", rotor=1, at_s=0.04, factor=0.5)
    physics = restartable(disturbances=Disturbances(Wind(gusts=(gust,)), faults=(fault,)))
    fly(physics, range(20))
    events = physics.take_events()
    assert [(event.t_ns, event.kind) for event in events] == [(40_000_000, "fault"), (60_000_000, "gust")]
    assert physics.wind_W_mps[0] > 0.0
    physics.restart()
    fly(physics, range(1000, 1009))
    assert physics.take_events() == []
    assert physics.wind_W_mps[0] == 0.0
    fly(physics, range(1009, 1020))
    assert physics.take_events() == [event._replace(t_ns=event.t_ns + 1000 * TICK_NS) for event in events]
    assert physics.take_events() == []


def test_ticks_must_still_come_in_order() -> None:
    physics = restartable()
    fly(physics, range(5))
    with pytest.raises(ValueError, match="ticks must come in order"):
        physics.advance(9, FULL)
    physics.restart()
    physics.advance(9, FULL)
    physics.advance(10, FULL)
