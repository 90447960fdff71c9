"""Long calls: what others are answered meanwhile, and that they change nothing but the time."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from hil.apps.airsim.rpc.methods import RpcError
from lab.airsim_server import RpcFailed
from tests.worlds.airsim_server import Client, Served, pose, served, vector
from tests.worlds.patience import PATIENCE_S

GRID = ("simCreateVoxelGrid", vector(0.0, 0.0, 0.0), 2, 2, 2, 1.0, "unused.binvox")


@contextmanager
def held(world: Served, work: Callable[[], Any]) -> Iterator[threading.Event]:
    """Let simCreateVoxelGrid wait until the event is set, and then do the work."""
    table = world.server.methods._methods
    before, go = table["simCreateVoxelGrid"], threading.Event()

    def long_call(*_: Any) -> Any:
        assert go.wait(PATIENCE_S)
        return work()

    table["simCreateVoxelGrid"] = before._replace(call=long_call)
    yield go
    go.set()
    table["simCreateVoxelGrid"] = before


def is_silent(client: Client) -> bool:
    client.socket.settimeout(0.1)
    try:
        client.socket.recv(1, socket.MSG_PEEK)
    except TimeoutError:
        return True
    finally:
        client.socket.settimeout(PATIENCE_S)
    return False


@pytest.fixture(scope="module")
def world() -> Iterator[Served]:
    with served() as running:
        yield running


def test_pings_are_answered_and_the_world_stands_still(world: Served) -> None:
    busy, other, third = world.client(), world.client(), world.client()
    with held(world, lambda: True) as go:
        grid = busy.send(*GRID)
        while not world.simulation.lock.held:
            assert third.call("ping") is True
        flying = other.send("simContinueForTime", 0.1)
        for name in ("ping", "getServerVersion"):
            assert third.call(name)
        state = third.send("getMultirotorState", "")
        after = third.send("ping")  # of a client whose call waits
        tick = world.simulation.world.tick
        assert is_silent(other)
        assert is_silent(third)
        assert world.simulation.world.tick == tick
        go.set()
        assert busy.join(grid) is True
        assert other.join(flying) is None
        assert third.join(state)["landed_state"] == 0
        assert third.join(after) is True
        assert world.simulation.world.tick == tick + 25


def fail() -> None:
    raise RpcError("no such grid")


def divide() -> float:
    return 1 / 0


@pytest.mark.parametrize(("work", "told"), [(fail, "no such grid"), (divide, "ZeroDivisionError.*defect")])
def test_an_error_of_a_long_call_is_that_of_its_client(world: Served, work: Callable[[], Any], told: str) -> None:
    client = world.client()
    with held(world, work) as go:
        go.set()
        with pytest.raises(RpcFailed, match=told):
            client.call(*GRID)
    assert client.call("getMultirotorState", "")


def test_clients_that_leave_during_a_long_call_are_forgotten(world: Served) -> None:
    busy, other = Client(world.port), Client(world.port)
    with held(world, lambda: True) as go:
        busy.send(*GRID)
        while not world.simulation.lock.held:
            assert other.call("ping") is True
        other.send("getMultirotorState", "")
        other.close()
        busy.close()
        assert world.client().call("ping") is True
        go.set()
    assert world.client().call("isApiControlEnabled", "") is False


def test_the_world_is_made_anew_in_a_thread_and_gives_the_same_replies() -> None:
    digests = set()
    for in_thread in (True, False):
        with served() as world:
            if not in_thread:
                world.server.methods.lock = None
            client = world.client()
            client.call("simSpawnObject", "box", "Cube", pose(5.0, 0.0, -1.0), vector(1.0, 1.0, 1.0), False)
            client.call("simGetImage", "0", 0)
            client.call("simSpawnObject", "roof", "Cube", pose(0.0, 0.0, -1.5), vector(2.0, 2.0, 0.1), False)
            client.call("enableApiControl", True, "")
            client.call("takeoff", 20.0, "")  # against the roof, which a tick needs
            assert client.call("simGetCollisionInfo", "")["object_name"] == "roof"
            assert world.server.digest is not None
            world.server.digest.update(world.truths.hexdigest().encode())
            digests.add(world.server.digest.hexdigest())
    assert len(digests) == 1
