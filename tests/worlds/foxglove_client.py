"""A client of Foxglove's WebSocket protocol (foxglove.sdk.v1) in a thread, written from its specification."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from tests.worlds.patience import PATIENCE_S, until

PROTOCOL = "foxglove.sdk.v1"
PARAMETERS = ["pace", "paused", "wind.steady_mps", "wind.turbulence_mps"]
_MESSAGE, _TIME, _SERVICE = 1, 2, 3
_SERVICE_REQUEST, _PLAYBACK_REQUEST, _PLAYBACK_STATE = 2, 3, 5


class FoxgloveClient:
    """Connects, subscribes to topics as they are advertised, and keeps what it gets."""

    def __init__(
        self,
        port: int,
        wanted: Callable[[str], bool] = lambda topic: True,
        *,
        keep: int = 400,
        origin: str | None = None,
        host: str = "127.0.0.1",
        at: str = "127.0.0.1",
    ) -> None:
        """`wanted`: topics to subscribe to. `keep`: newest messages of each topic. `origin`: of a page in a browser.

        `host`: name that the client uses for the machine at the address `at`.
        """
        self.port, self._wanted, self._keep = port, wanted, keep
        self.server: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}  # by topic
        self.services: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = defaultdict(list)  # log time [ns], payload
        self.counts: dict[str, int] = defaultdict(int)
        self.status: list[dict[str, Any]] = []
        self.parameters: dict[str, Any] = {}
        self.playback: list[tuple[int, int, float]] = []  # status, time [ns], speed
        self.time_ns = 0
        self.bytes = 0
        self._answers: dict[int, Any] = {}
        self._calls = 0
        self._topics: dict[int, str] = {}  # by subscription
        self._stack = ExitStack()
        self._socket: ClientConnection = self._stack.enter_context(
            connect(
                f"ws://{host}:{port}",
                subprotocols=[Subprotocol(PROTOCOL)],
                max_size=None,
                compression=None,
                proxy=None,
                open_timeout=PATIENCE_S,
                origin=None if origin is None else Origin(origin),
                sock=socket.create_connection((at, port)),
            )
        )
        assert self._socket.subprotocol == PROTOCOL
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def say(self, **message: Any) -> None:
        self._socket.send(json.dumps(message))

    def set(self, name: str, value: Any) -> None:
        self.say(op="setParameters", parameters=[{"name": name, "value": value}], id="set")

    def ask_parameters(self) -> None:
        self.say(op="getParameters", parameterNames=[], id="get")

    def call(self, service: str, request: Any = None, limit_s: float = PATIENCE_S) -> Any:
        """Call a service; return its answer, or the text of its failure."""
        self._calls += 1
        number, payload = self._calls, json.dumps(request if request is not None else {}).encode()
        head = struct.pack("<BIII", _SERVICE_REQUEST, self.services[service]["id"], number, 4)
        self._socket.send(head + b"json" + payload)
        assert self.until(lambda: number in self._answers, limit_s), f"{service} did not answer"
        return self._answers.pop(number)

    def playback_control(self, command: int, speed: float = 1.0) -> None:
        """`command`: 0 play, 1 pause."""
        request = b"r1"
        self._socket.send(struct.pack("<BBfBQI", _PLAYBACK_REQUEST, command, speed, 0, 0, len(request)) + request)

    def until(self, met: Callable[[], Any], limit_s: float = PATIENCE_S) -> bool:
        """Wait for a condition; return False after the limit."""
        end_s = time.monotonic() + limit_s
        while not met():
            if time.monotonic() > end_s:
                return False
            time.sleep(0.01)
        return True

    def close(self) -> None:
        with contextlib.suppress(ConnectionClosed, OSError):
            self._stack.close()
        self._thread.join(PATIENCE_S)

    def join(self, limit_s: float = PATIENCE_S) -> bool:
        """Wait until the server has closed the connection."""
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed, OSError):
            for message in self._socket:
                self.bytes += len(message)
                if isinstance(message, str):
                    self._take_text(json.loads(message))
                else:
                    self._take_bytes(message)

    def _take_text(self, message: dict[str, Any]) -> None:
        kind = message["op"]
        if kind == "serverInfo":
            self.server = message
            if "parametersSubscribe" in message["capabilities"]:
                self.say(op="subscribeParameterUpdates", parameterNames=PARAMETERS)
        elif kind == "advertise":
            subscriptions = []
            for channel in message["channels"]:
                topic = channel["topic"]
                self.channels[topic] = channel
                if self._wanted(topic):
                    self._topics[channel["id"]] = topic
                    subscriptions.append({"id": channel["id"], "channelId": channel["id"]})
            if subscriptions:
                self.say(op="subscribe", subscriptions=subscriptions)
        elif kind == "advertiseServices":
            self.services |= {service["name"]: service for service in message["services"]}
        elif kind == "status":
            self.status.append(message)
        elif kind == "parameterValues":
            self.parameters |= {p["name"]: p.get("value") for p in message["parameters"]}
        elif kind == "serviceCallFailure":
            self._answers[message["callId"]] = message["message"]

    def _take_bytes(self, data: bytes) -> None:
        kind = data[0]
        if kind == _MESSAGE:
            subscription, log_ns = struct.unpack_from("<IQ", data, 1)
            topic = self._topics[subscription]
            self.counts[topic] += 1
            kept = self.messages[topic]
            kept.append((log_ns, data[13:]))
            del kept[: -self._keep]
        elif kind == _TIME:
            (self.time_ns,) = struct.unpack_from("<Q", data, 1)
        elif kind == _SERVICE:
            _, call, length = struct.unpack_from("<III", data, 1)
            self._answers[call] = json.loads(data[13 + length :])
        elif kind == _PLAYBACK_STATE:
            status, now_ns, speed = struct.unpack_from("<BQf", data, 1)
            self.playback.append((status, now_ns, speed))


def wire_fields(data: bytes) -> dict[int, list[Any]]:
    """Return the fields of a protobuf message by number: integers, doubles, or bytes of texts and messages."""
    fields: dict[int, list[Any]] = defaultdict(list)
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(data):
        key = varint()
        number, kind = key >> 3, key & 7
        if kind == 0:
            fields[number].append(varint())
        elif kind == 1:
            fields[number].append(struct.unpack_from("<d", data, at)[0])
            at += 8
        elif kind == 2:
            length = varint()
            fields[number].append(data[at : at + length])
            at += length
        else:
            fields[number].append(struct.unpack_from("<f", data, at)[0])
            at += 4
    return fields


def connected(port: int, *wanted: Callable[[str], bool]) -> FoxgloveClient:
    """Return a client of a server that may not listen yet."""

    def client() -> FoxgloveClient | None:
        with contextlib.suppress(OSError):
            return FoxgloveClient(port, *wanted)
        return None

    return until(client, "Foxglove's server")
