"""Parameters of the live Foxglove server change while clients subscribe to them and leave."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.worlds.foxglove_client import PROTOCOL
from tests.worlds.patience import PATIENCE_S

pytest.importorskip("foxglove")

# A process of its own: in one that is frozen, neither signal handlers nor time limits of a test run.
_SERVER = """
import sys, threading
from hil.config.schema import Foxglove
from hil.run.parts.links.foxglove.commands import PACE, Commands
from hil.run.parts.links.foxglove.server import LiveServer

server = LiveServer(Foxglove(port=0))
commands = Commands(server)
server.start("run", commands, ["Parameters"], [], None)
print(server.address, flush=True)
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
pace = 0
while not ended.wait(0.001):
    pace += 1
    commands.show({PACE: float(pace)})
server.stop()
print(pace)
"""


def _next_pace(socket: ClientConnection) -> float:
    """Wait for the value of a parameter."""
    while True:
        message = socket.recv(PATIENCE_S)
        if isinstance(message, str) and (told := json.loads(message))["op"] == "parameterValues":
            return float({each["name"]: each["value"] for each in told["parameters"]}["pace"])


def test_values_that_change_reach_clients_that_come_and_go() -> None:
    server = subprocess.Popen([sys.executable, "-c", _SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        seen: list[float] = []
        for _ in range(100):
            with connect(
                address,
                subprotocols=[Subprotocol(PROTOCOL)],
                compression=None,
                proxy=None,
                open_timeout=PATIENCE_S,
                close_timeout=PATIENCE_S,
            ) as socket:
                for kind in ("subscribe", "unsubscribe", "subscribe"):
                    socket.send(json.dumps({"op": f"{kind}ParameterUpdates", "parameterNames": ["pace"]}))
                seen.append(_next_pace(socket))
        assert seen == sorted(seen)
        last, _ = server.communicate(timeout=PATIENCE_S)
        assert seen[0] < seen[-1] <= float(last)
        assert server.returncode == 0
    finally:
        server.kill()
        server.communicate()
