"""`hil airsim` in a process of its own and a blocking client of its protocol, for `hil bench airsim`."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import msgpack

from hil.apps.bench_suite.timing import processor_s, resident_mib
from signals.errors import HilError

_ADDRESS = re.compile(r"airsim: 127\.0\.0\.1:(\d+)")
_WAIT_S = 120.0  # on a busy machine a server takes long to start


class RpcFailed(HilError):
    """Error in a reply: the server's text, which names the call."""


class Disconnected(HilError, ConnectionError):
    """The server has closed the connection."""


class BenchClient:
    """One connection to a server; calls are answered one after the other."""

    def __init__(self, port: int, timeout_s: float = _WAIT_S) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout_s)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unpacker = msgpack.Unpacker(raw=False, strict_map_key=False, max_buffer_size=1 << 28)
        self._number = 0
        self._replies: dict[int, tuple[Any, Any]] = {}

    def send(self, method: str, *arguments: Any) -> int:
        """Send a request and return its number."""
        self._number += 1
        self.socket.sendall(msgpack.packb([0, self._number, method, list(arguments)]))
        return self._number

    def join(self, number: int) -> Any:
        """Return the result of a request. Raises RpcFailed, Disconnected."""
        while number not in self._replies:
            data = self.socket.recv(1 << 20)
            if not data:
                raise Disconnected("the server of AirSim's API closed the connection")
            self._unpacker.feed(data)
            for _, replied, error, result in self._unpacker:
                self._replies[replied] = (error, result)
        error, result = self._replies.pop(number)
        if error is not None:
            raise RpcFailed(str(error))
        return result

    def call(self, method: str, *arguments: Any) -> Any:
        """Call a method and return its result. Raises RpcFailed, Disconnected."""
        return self.join(self.send(method, *arguments))

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()


class BenchServer:
    """Server in a process of its own: `with BenchServer(folder, settings, clock) as server:`."""

    def __init__(self, folder: Path, settings: dict[str, Any], clock: str) -> None:
        self._folder = folder
        self._command = [sys.executable, "-P", "-m", "hil.cli", "airsim", "--port", "0", "--scene", "Blocks"]
        self._command += ["--clock", clock, "--settings", json.dumps(settings), "--out", str(folder / "run")]
        self._clients: list[BenchClient] = []
        self.port = 0

    def __enter__(self) -> BenchServer:
        self._folder.mkdir(parents=True, exist_ok=True)
        log = self._folder / "log.txt"
        with log.open("w") as file:
            self._process = subprocess.Popen(
                self._command, stdout=file, stderr=file, env=os.environ | {"COLUMNS": "400"}
            )
        end_s = time.monotonic() + _WAIT_S
        while (found := _ADDRESS.search(log.read_text())) is None:
            if self._process.poll() is not None or time.monotonic() > end_s:
                self.__exit__()
                raise HilError(f"the server of AirSim's API did not start: {log.read_text()[-2000:]}")
            time.sleep(0.05)
        self.port = int(found.group(1))
        return self

    def __exit__(self, *_: object) -> None:
        for client in self._clients:
            client.close()
        self._process.kill()
        self._process.wait()

    def client(self) -> BenchClient:
        """Return a new client, which is closed with the server."""
        self._clients.append(BenchClient(self.port))
        return self._clients[-1]

    def finish(self) -> dict[str, Any]:
        """End the server and return its airsim.json."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(_WAIT_S)
        report: dict[str, Any] = json.loads((self._folder / "run" / "airsim.json").read_text())
        return report

    def processor_s(self) -> float:
        """Return the processor time of all its threads [s]; NaN where the system does not tell."""
        return processor_s(self._process.pid)

    def resident_mib(self) -> float:
        """Return its resident memory [MiB]; NaN where the system does not tell."""
        return resident_mib(self._process.pid)

    def open_files(self) -> float:
        """Return the number of its open files; NaN where the system does not tell."""
        try:
            return float(len(os.listdir(f"/proc/{self._process.pid}/fd")))
        except OSError:
            return float("nan")
