"""Foxglove's WebSocket server with the channels of a run. The SDK (package foxglove-sdk) does the protocol.

The SDK has threads of its own and a queue of limited length for each client: a slow client loses the oldest messages,
and the run never waits for one. Messages of topics without a subscriber are not encoded.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from contextlib import suppress
from types import ModuleType
from typing import Any

from firmware_bridge.transports.loopback_host import is_loopback
from hil.config.schema import Foxglove
from hil.run.parts.links.foxglove.gate import Gate, inner_addresses
from hil.run.parts.links.foxglove.own_client import OwnClient
from hil.run.recorder.mcap.cdr import MESSAGE_PREFIX, schema_text
from hil.run.recorder.mcap.mcap_file import Block
from signals.errors import ConfigError, LinkError, Problem

INSTALL = "pip install 'hil-bench[foxglove]'"
_STOP_S = 2.0  # longest wait for the server at the end
_BACKLOG = 1024  # messages that wait for one client, three updates; it then loses the oldest


def installed_sdk() -> ModuleType:
    """Return the module `foxglove`. Raises ConfigError where the package is not installed."""
    try:
        import foxglove
        import foxglove.channels
        import foxglove.websocket
    except ImportError as error:
        problem = Problem("foxglove.port", f"needs the package foxglove-sdk, which is not installed ({error})", INSTALL)
        raise ConfigError([problem]) from error
    logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # clients get these texts as status messages
    return foxglove


class LiveServer:
    """The server of one run. `log` and `publish` are called by one thread at a time."""

    def __init__(self, settings: Foxglove) -> None:
        """Load the SDK. Raises ConfigError where it is not installed."""
        self._settings = settings
        self.sdk: Any = installed_sdk()
        self._context: Any = self.sdk.Context()
        self._server: Any = None
        self._gate: Gate | None = None
        self._own_client: OwnClient | None = None
        self._channels: dict[str, Any] = {}
        self._blocks: list[Any] = []  # channel of each number given to a series of the recorder
        # Topic -> key -> newest message: for late subscribers, of the scene, mounts of sensors and the plan.
        self._latched: dict[str, dict[str, Any]] = {}
        self._lock = threading.Lock()

    # -- life -------------------------------------------------------------------------------------------------------

    def start(
        self, name: str, listener: Any, capabilities: Sequence[str], services: Sequence[Any], end_ns: int | None
    ) -> None:
        """Listen, once the first topics have been offered. Raises LinkError, also as PortBusy and PortNotFound.

        `capabilities`: names of `foxglove.websocket.Capability`. `end_ns`: latest end of the run, for playback control.
        """
        sdk = self.sdk
        kinds = sdk.websocket.Capability
        host, port = self._settings.host, self._settings.port
        assert port is not None  # without it nothing is served
        gate = Gate(host, port, loopback_only=is_loopback(host), sites=self._settings.origins)
        reason: Exception | None = None
        for inner in inner_addresses():
            try:
                self._server = sdk.start_server(
                    name=name,
                    host=inner[0],
                    port=inner[1],
                    capabilities=[getattr(kinds, each) for each in capabilities],
                    server_listener=listener,
                    supported_encodings=["json"],
                    services=list(services) or None,
                    context=self._context,
                    playback_time_range=None if end_ns is None else (0, end_ns),
                    message_backlog_size=_BACKLOG,
                )
            except RuntimeError as error:  # of the port
                reason = error
                continue
            self._gate = gate
            if "Parameters" in capabilities:
                self._own_client = OwnClient(inner)
            gate.start(inner)
            return
        gate.close(0.0)
        raise LinkError("Foxglove's server", f"has no address behind its gate: {reason}") from reason

    @property
    def address(self) -> str:
        """Address for Foxglove's dialog "Open connection"."""
        host = self._settings.host
        return f"ws://{f'[{host}]' if ':' in host else host}:{self._gate.port if self._gate else 0}"

    def refusals(self) -> list[str]:
        """Return what the gate has refused since the last call, for people."""
        return [self._gate.refusals.popleft() for _ in range(len(self._gate.refusals))] if self._gate else []

    @property
    def serves(self) -> bool:
        return self._server is not None

    def stop(self, last: str = "") -> None:
        """Show a last text in all clients, if one is given, and close all connections. Idempotent."""
        if last and self._gate is not None and self.serves:
            with suppress(Exception):  # the run's result matters more
                self._gate.pass_on_last(last, self.status, _STOP_S)
        if self._own_client is not None:
            self._own_client.close()
        with self._lock:
            server, self._server = self._server, None
        if server is not None:
            # The SDK waits for clients that read nothing, without a limit.
            stopping = threading.Thread(target=_stop, args=(server,), name="foxglove stop", daemon=True)
            stopping.start()
            stopping.join(_STOP_S)
        if self._gate is not None:
            self._gate.close(_STOP_S)

    # -- messages ---------------------------------------------------------------------------------------------------

    def declare(self, topic: str, type_name: str) -> None:
        """Offer a topic of ROS 2 type "package/Name" with CDR messages."""
        if topic not in self._channels:
            schema = self.sdk.Schema(
                name=type_name.replace("/", "/msg/"), encoding="ros2msg", data=schema_text(type_name).encode()
            )
            channel = self.sdk.Channel(topic, message_encoding="cdr", schema=schema, context=self._context)
            self._channels[topic] = channel

    def declare_typed(self, topic: str, message: str) -> None:
        """Offer a topic of one of Foxglove's own messages, such as "SceneUpdate"."""
        make = getattr(self.sdk.channels, f"{message}Channel")
        self._channels[topic] = make(topic, context=self._context)

    def wanted(self) -> frozenset[str]:
        """Return the topics that clients have subscribed to."""
        return frozenset(topic for topic, channel in self._channels.items() if channel.has_sinks())

    def log(self, topic: str, message: Any, t_ns: int, *, latch: str | None = None) -> None:
        """Send bytes or a message of the SDK at a simulated time. `latch`: key under which later subscribers get it."""
        if latch is not None:
            self._latched.setdefault(topic, {})[latch] = message
        channel = self._channels.get(topic)
        if channel is not None:
            channel.log(message, log_time=t_ns)

    def repeat(self, topic: str, t_ns: int) -> None:
        """Send the latched messages of a topic again, for a new subscriber."""
        for message in self._latched.get(topic, {}).values():
            self._channels[topic].log(message, log_time=t_ns)

    def broadcast_time(self, t_ns: int) -> None:
        if self._server is not None:
            self._server.broadcast_time(t_ns)

    def status(self, text: str, *, level: str = "Info") -> None:
        """Show a text in all clients. `level`: Info, Warning or Error."""
        if self._server is not None:
            self._server.publish_status(text, getattr(self.sdk.StatusLevel, level))

    def parameters_changed(self) -> None:
        """Let the clients that subscribed to parameters get them as `on_set_parameters` then returns them."""
        if self._own_client is not None:
            self._own_client.ask()

    def playback(self, state: Any) -> None:
        if self._server is not None:
            self._server.broadcast_playback_state(state)

    # -- for the recorder's series: the methods of `McapFile` ---------------------------------------------------------

    def frame(self, frame_id: str) -> str:
        """Return the name of a coordinate frame."""
        return frame_id

    def channel(self, topic: str, type_name: str, schema_text: str) -> int:  # noqa: ARG002
        """Offer a topic and return its number."""
        self.declare(topic, type_name)
        self._blocks.append(self._channels[topic])
        return len(self._blocks) - 1

    def publish(self, block: Block) -> None:
        """Send the records of a block without their MCAP prefix."""
        if not len(block.log_ns):
            return
        data = b"".join(block.parts)
        ends = [*block.offsets.tolist()[1:], len(data)]
        channel = self._blocks[block.channel]
        for log_ns, begin, end in zip(block.log_ns.tolist(), block.offsets.tolist(), ends, strict=True):
            channel.log(data[begin + MESSAGE_PREFIX.size : end], log_time=log_ns)


def _stop(server: Any) -> None:
    with suppress(Exception):  # a run's end is not an error of the run
        server.stop()
