"""A server of AirSim's API in a thread, and a client of it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.clock import CallsClock, WallClock
from hil.apps.airsim.command import Choice, TruthDigest, make_simulation
from hil.apps.airsim.rpc.server import RpcServer
from hil.apps.airsim.settings.settings import read_settings
from hil.apps.airsim.simulation import Simulation
from lab.airsim_server import BenchClient
from tests.worlds.patience import PATIENCE_S


def vector(x: float, y: float, z: float) -> dict[str, float]:
    """Return AirSim's Vector3r."""
    return {"x_val": x, "y_val": y, "z_val": z}


def xyz(value: dict[str, float]) -> tuple[float, float, float]:
    """Return the components of a Vector3r."""
    return (value["x_val"], value["y_val"], value["z_val"])


def pose(x: float, y: float, z: float, q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Return AirSim's Pose; `q` is w, x, y, z."""
    return {
        "position": vector(x, y, z),
        "orientation": dict(zip(("w_val", "x_val", "y_val", "z_val"), q, strict=True)),
    }


class Client(BenchClient):
    """Client of a server; messages are sent and read one by one."""

    def is_closed(self) -> bool:
        """Return True if the server has closed the connection; waits for something to come."""
        try:
            return self.socket.recv(1) == b""
        except ConnectionError:
            return True


class Served:
    """A running server."""

    def __init__(self, simulation: Simulation, server: RpcServer, truths: TruthDigest, log: list[str]) -> None:
        self.simulation, self.server, self.truths, self.log = simulation, server, truths, log
        self.port = 0
        self._clients: list[Client] = []

    def client(self) -> Client:
        """Return a new client."""
        self._clients.append(Client(self.port, PATIENCE_S))
        return self._clients[-1]

    def close(self) -> None:
        """Close all clients."""
        for client in self._clients:
            client.close()


@contextlib.contextmanager
def served(settings: str = "{}", *, clock: str = "calls", scene: str = "airfield") -> Iterator[Served]:
    """Serve in a thread until the block ends. An error of the server's loop is raised at the end."""
    log: list[str] = []
    parsed = read_settings(settings, "settings.json")
    simulation = make_simulation(Choice(scene=scene), parsed, log.append)
    server = RpcServer(method_table(simulation), log.append, digest=True)
    world = Served(simulation, server, TruthDigest(simulation), log)
    ready, stop = threading.Event(), asyncio.Event()
    loop = asyncio.new_event_loop()
    errors: list[BaseException] = []

    async def serve() -> None:
        driver = CallsClock(simulation) if clock == "calls" else WallClock(simulation, parsed.clock_speed)
        world.port = await server.start("127.0.0.1", 0)
        running, stopped = asyncio.create_task(driver.run()), asyncio.create_task(stop.wait())
        ready.set()
        await asyncio.wait({running, stopped}, return_when=asyncio.FIRST_COMPLETED)
        await server.stop()
        if running.done():
            running.result()
        running.cancel()

    def run() -> None:
        try:
            loop.run_until_complete(serve())
        except BaseException as error:  # noqa: BLE001 (raised in the main thread)
            errors.append(error)
        finally:
            ready.set()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert ready.wait(PATIENCE_S)
        if not errors:
            yield world
    finally:
        loop.call_soon_threadsafe(stop.set)
        world.close()
        thread.join(PATIENCE_S)
        loop.close()
    if errors:
        raise errors[0]
