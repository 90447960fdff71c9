"""The `hil` command in a process of its own: to its end, or as a bench for real clients."""

from __future__ import annotations

import http.client
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.worlds.hop_flights import HOP
from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
BENCH = "mission: hop.waypoints\nautopilot: {transport: loopback}\nrecord: {mcap: false, tlog: false, report: false}\n"


def hil(*arguments: str, cwd: Path = ROOT, **kwargs: object) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    command = [sys.executable, "-m", "hil.cli.entry", *arguments]
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | kwargs.pop("env", {})  # type: ignore[operator, arg-type]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 2 * PATIENCE_S} | kwargs
    return subprocess.run(command, cwd=cwd, check=False, env=environment, **options)  # type: ignore[call-overload]


class BenchProcess:
    """`with BenchProcess(out, "pace=4", ...) as bench:`; killed at the end if it still runs."""

    def __init__(self, out: Path, *settings: str, bench: Path | None = None) -> None:
        self.out = out
        files = [] if bench is None else [str(bench)]
        self._command = [sys.executable, "-m", "hil.cli", "run", *files, "--quiet", "--out", str(out)]
        self._command += [word for setting in (*settings, "record.report=false") for word in ("--set", setting)]

    def __enter__(self) -> BenchProcess:
        log = (self.out / "stderr.txt").open("w")
        self._process = subprocess.Popen(self._command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=log)
        log.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def finish(self, limit_s: float = 2 * PATIENCE_S) -> dict[str, Any]:
        """Wait for its end and return its run.json."""
        self._process.wait(limit_s)
        assert (self.out / "run.json").exists(), (self.out / "stderr.txt").read_text()
        return json.loads((self.out / "run.json").read_text())


def _worker() -> int:
    """Return the number of this worker of pytest-xdist, of which there are up to five."""
    return int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 5


def _take(stack: ExitStack, kind: socket.SocketKind, port: int) -> None:
    """Hold a port of loopback for as long as the stack is open. Raises OSError if it is in use."""
    holder = stack.enter_context(socket.socket(socket.AF_INET, kind))
    if kind is socket.SOCK_STREAM:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    holder.bind(("127.0.0.1", port))


def free_port(following: int = 0) -> int:
    """Return a port that is free for UDP and TCP, as are the `following` next ones.

    Each worker has numbers of its own, below those that the system gives out, so that no other test takes the port
    before it is used.
    """
    for port in random.sample(range(20_000 + 1000 * _worker(), 21_000 + 1000 * _worker() - following), 100):
        with ExitStack() as stack:
            try:
                for each in range(port, port + following + 1):
                    _take(stack, socket.SOCK_DGRAM, each)
                    _take(stack, socket.SOCK_STREAM, each)
            except OSError:
                continue
            return port
    raise AssertionError("no port is free")


def free_instance() -> int:
    """Return an `autopilot.instance` whose ports are free, of PX4 and of ArduPilot.

    Each worker has numbers of its own: looking whether a port is free takes it, for a moment, from a test of another.
    """
    for number in random.sample(range(20 + 16 * _worker(), 36 + 16 * _worker()), 16):
        with ExitStack() as stack:
            try:
                _take(stack, socket.SOCK_STREAM, 4560 + number)
                for port in (18570 + number, 9002 + 10 * number):
                    _take(stack, socket.SOCK_DGRAM, port)
            except OSError:
                continue
            return number
    raise AssertionError("no instance is free")


class Hil:
    """A `hil` command that prints an address."""

    def __init__(self, folder: Path, *arguments: str, bench: str = BENCH) -> None:
        (folder / "hil.yaml").write_text(bench)
        (folder / "hop.waypoints").write_text(HOP)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "hil.cli.entry", *arguments],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "200"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        found = re.search(r"http://\S+", self.process.stdout.readline())
        assert found, self.process.communicate(timeout=PATIENCE_S)
        self.address = found[0]
        self.host = urlsplit(self.address).netloc

    def get(self, path: str, **headers: str) -> http.client.HTTPResponse:
        link = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        link.request("GET", path, headers={"Host": self.host} | headers)
        return link.getresponse()

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=PATIENCE_S)
