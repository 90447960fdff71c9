"""A server of AirSim's API in a thread, and a small client that speaks MessagePack-RPC over a socket."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

import msgpack

from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.clock import CallsClock, WallClock
from hil.apps.airsim.command import Choice, TruthDigest, make_simulation
from hil.apps.airsim.rpc.server import RpcServer
from hil.apps.airsim.settings.settings import read_settings
from hil.apps.airsim.simulation import Simulation
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


class RpcFailed(Exception):
    """Error in a reply."""


class Client:
    """Client of a server; messages are sent and read one by one."""

    def __init__(self, port: int, timeout_s: float = PATIENCE_S) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout_s)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unpacker = msgpack.Unpacker(raw=False, strict_map_key=False)
        self._next = 0
        self._replies: dict[int, tuple[Any, Any]] = {}

    def send(self, name: str, *arguments: Any) -> int:
        """Send a request and return its id."""
        self._next += 1
        self.socket.sendall(msgpack.packb([0, self._next, name, list(arguments)]))
        return self._next

    def join(self, request: int) -> Any:
        """Return the result of a request. Raises RpcFailed, or ConnectionError if the server closed the connection."""
        while request not in self._replies:
            data = self.socket.recv(1 << 16)
            if not data:
                raise ConnectionError("closed by the server")
            self._unpacker.feed(data)
            for kind, number, error, result in self._unpacker:
                assert kind == 1
                self._replies[number] = (error, result)
        error, result = self._replies.pop(request)
        if error is not None:
            raise RpcFailed(error)
        return result

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a method and return its result."""
        return self.join(self.send(name, *arguments))

    def is_closed(self) -> bool:
        """Return True if the server has closed the connection; waits for something to come."""
        try:
            return self.socket.recv(1) == b""
        except ConnectionError:
            return True

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()


class Served:
    """A running server."""

    def __init__(self, simulation: Simulation, server: RpcServer, truths: TruthDigest, log: list[str]) -> None:
        self.simulation, self.server, self.truths, self.log = simulation, server, truths, log
        self.port = 0
        self._clients: list[Client] = []

    def client(self) -> Client:
        """Return a new client."""
        self._clients.append(Client(self.port))
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
