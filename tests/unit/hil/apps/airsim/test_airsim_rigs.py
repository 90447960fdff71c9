"""PX4Multirotor: a vehicle that an autopilot of a rig flies, here the mock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.command import Choice, make_simulation
from hil.apps.airsim.rpc.methods import MethodTable, Pending, RpcError
from hil.apps.airsim.settings.settings import read_settings
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.rig_flight import RigFlight
from hil.config import load_bench
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle

SETTINGS = """{"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": {
    "P": {"VehicleType": "PX4Multirotor"}, "S": {"VehicleType": "SimpleFlight", "X": 4}}}"""
STRAIGHT = {"is_rate": True, "yaw_or_rate": 0.0}


@pytest.fixture
def world() -> Iterator[tuple[Simulation, MethodTable]]:
    bench = load_bench(rig="mock", scene="airfield", settings=("autopilot.transport=loopback",), flown=False)
    asked: list[str] = []

    def rigs(name: str) -> object:
        asked.append(name)
        return bench

    settings = read_settings(SETTINGS, "settings.json")
    simulation = Simulation(bench, settings, lambda _text: None, rigs)  # type: ignore[arg-type]
    assert asked == ["px4_sitl"]
    yield simulation, method_table(simulation)
    simulation.close()


def joined(simulation: Simulation, pending: object, limit_s: float = 60.0) -> object:
    """Step until a move is over, and return its result."""
    assert isinstance(pending, Pending)
    end = simulation.world.tick + round(limit_s * 250)
    while not pending.done:
        assert simulation.world.tick < end, "the move does not end"
        simulation.step()
    return pending.result


def test_a_flight(world: tuple[Simulation, MethodTable]) -> None:
    simulation, table = world
    with pytest.raises(RpcError, match="enableApiControl"):
        table.call("takeoff", [20.0, "P"])
    table.call("enableApiControl", [True, "P"])
    assert table.call("armDisarm", [True, "P"]) is True
    assert joined(simulation, table.call("takeoff", [20.0, "P"])) is True
    move = table.call("moveToPosition", [5.0, 3.0, -4.0, 3.0, 60.0, 0, STRAIGHT, -1.0, 1.0, "P"])
    assert joined(simulation, move) is True
    assert tuple(table.call("getPosition", ["P"])) == pytest.approx((5.0, 3.0, -4.0), abs=0.6)
    assert joined(simulation, table.call("moveByVelocity", [0.0, 1.0, 0.0, 2.0, 0, STRAIGHT, "P"])) is True
    with pytest.raises(RpcError, match="autopilot of its own"):
        table.call("setPositionControllerGains", [[0.25] * 3, [0.0] * 3, [0.0] * 3, "P"])
    error = joined(simulation, table.call("moveByRollPitchYawZ", [0.1, 0.0, 0.0, -4.0, 1.0, "P"]))
    assert "this move needs simple_flight" in str(error)
    assert joined(simulation, table.call("land", [60.0, "P"])) is True
    assert table.call("getLandedState", ["P"]) == 0
    assert joined(simulation, table.call("takeoff", [20.0, "P"])) is True  # once more
    assert table.call("getPosition", ["P"])[2] < -1.4
    table.call("reset", [])
    assert tuple(table.call("getPosition", ["P"])) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    table.call("enableApiControl", [True, "P"])
    assert joined(simulation, table.call("takeoff", [20.0, "P"])) is True
    assert tuple(table.call("getPosition", ["P"])) == pytest.approx((0.0, 0.0, -2.0), abs=0.6)


def test_an_autopilot_that_does_not_start_again_ends_no_tick(
    world: tuple[Simulation, MethodTable], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation, table = world

    def fail(*_: object) -> object:
        raise OSError("no such program")

    flight = simulation.drones["P"].flight
    assert isinstance(flight, RigFlight)
    flight._flown = True
    monkeypatch.setattr(flight, "_make", fail)
    monkeypatch.setattr(flight, "observe", fail)
    simulation.step()
    simulation.step()
    table.call("enableApiControl", [True, "P"])
    with pytest.raises(RpcError, match="autopilot has ended"):
        table.call("takeoff", [20.0, "P"])


def test_without_a_rig_it_is_a_named_error() -> None:
    bench = load_bench(rig="mock", scene="airfield", flown=False)
    with pytest.raises(ConfigError, match=r"Vehicles\.P\.VehicleType: PX4Multirotor cannot be flown here"):
        Simulation(bench, read_settings(SETTINGS, "settings.json"), print)


def test_a_plane_is_a_named_error() -> None:
    bench = replace(load_bench(rig="mock", scene="airfield", flown=False), vehicle=load_vehicle("skywalker_x8"))
    with pytest.raises(
        ConfigError, match=r"skywalker_x8 .* AirSim has multirotors and cars, and its API flies no plane"
    ):
        Simulation(bench, read_settings('{"SettingsVersion": 1.2, "SimMode": "Multirotor"}', "settings.json"), print)


def test_a_rig_without_its_firmware_is_a_named_error() -> None:
    with pytest.raises(ConfigError, match=r"autopilot\.binary"):
        make_simulation(Choice(scene="airfield"), read_settings(SETTINGS, "settings.json"), print)
