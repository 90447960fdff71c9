"""One ROUTER socket of the bench: bound, limited, encrypted where it has keys, and told who has gone. Never waits."""

from __future__ import annotations

import errno
import os
import socket
from contextlib import suppress
from typing import NamedTuple

import zmq
from zmq.utils.monitor import recv_monitor_message

from firmware_bridge.companion.connections import Connections
from firmware_bridge.companion.doorkeeper import DOMAIN
from firmware_bridge.companion.keys import KeyPair
from firmware_bridge.companion.settings import CompanionSettings
from hil.signals.errors import PortBusy, PortNotFound

_SEND_HWM = 192  # messages to one client: 64 frames, and answers to pings
_RECEIVE_HWM = 16  # messages of one client that wait here
_HANDSHAKE_MS = 3000
_EVENTS = (
    zmq.EVENT_ACCEPTED
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
_CONNECTIONS_PER_CLIENT = 4


class Received(NamedTuple):
    """A message of a client, or of a stranger."""

    identity: bytes
    fd: int  # of its connection
    raw: memoryview  # part 0
    parts: int
    frame: zmq.Frame  # of part 0, for what else ZeroMQ knows


class Unreachable(Exception):  # never leaves the companion package
    """The peer has gone."""


class BenchSocket:
    """A bound ROUTER. `endpoint` is where it listens, with the port that it got."""

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], address: str, settings: CompanionSettings, keys: KeyPair | None
    ) -> None:
        self._socket = context.socket(zmq.ROUTER)
        s = self._socket
        s.setsockopt(zmq.LINGER, 0)
        s.setsockopt(zmq.ROUTER_MANDATORY, 1)
        s.setsockopt(zmq.SNDHWM, _SEND_HWM)
        s.setsockopt(zmq.RCVHWM, _RECEIVE_HWM)
        s.setsockopt(zmq.MAXMSGSIZE, settings.max_message_bytes)
        s.setsockopt(zmq.HANDSHAKE_IVL, _HANDSHAKE_MS)
        s.setsockopt(zmq.HEARTBEAT_IVL, settings.heartbeat_interval_ms)
        s.setsockopt(zmq.HEARTBEAT_TIMEOUT, settings.heartbeat_timeout_ms)
        s.setsockopt(zmq.HEARTBEAT_TTL, settings.heartbeat_timeout_ms)
        if address.startswith("tcp://["):
            s.setsockopt(zmq.IPV6, 1)
        if keys is not None:
            s.curve_server = True
            s.curve_secretkey = keys.secret
            s.curve_publickey = keys.public
            s.zap_domain = DOMAIN.encode("ascii")
        self.connections = Connections(
            limit=_CONNECTIONS_PER_CLIENT * settings.max_clients, unread_limit=settings.unread_bytes_limit
        )
        self._monitor = s.get_monitor_socket(_EVENTS)
        try:
            _bind(s, address)
        except BaseException:
            self._end_monitor()
            s.close()
            raise
        self.endpoint = s.getsockopt_string(zmq.LAST_ENDPOINT)

    def register(self, poller: zmq.Poller) -> None:
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._monitor, zmq.POLLIN)

    def receive(self) -> Received | None:
        """The next message; None while there is none."""
        try:
            parts = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return None
        last = parts[-1]
        fd = int(last.get(zmq.SRCFD)) if len(parts) > 1 else -1
        self.connections.consumed(fd, sum(len(p) for p in parts), len(parts))
        first = parts[1] if len(parts) > 1 else last
        return Received(parts[0].bytes, fd, first.buffer, len(parts) - 1, first)

    def send(self, identity: bytes, parts: list[bytes | zmq.Frame]) -> bool:
        """Whether there was room. Unreachable if the peer has gone."""
        try:
            self._socket.send_multipart([identity, *parts], zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return False
        except zmq.ZMQError as error:
            if error.errno == zmq.EHOSTUNREACH:
                raise Unreachable from None
            raise
        return True

    def gone(self) -> tuple[list[int], list[str]]:
        """Descriptors of connections that have ended since, and what else happened, for people to read."""
        ended: list[int] = []
        texts: list[str] = []
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor, zmq.NOBLOCK)
            kind, value = event["event"], event["value"]
            if kind == zmq.EVENT_ACCEPTED:
                why = self.connections.accepted(value)
                if why is not None:
                    texts.append(why)
            elif kind == zmq.EVENT_DISCONNECTED:
                self.connections.gone(value)
                ended.append(value)
            elif kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                texts.append("a client was turned away: its key is not among the allowed ones")
            else:
                texts.append(
                    "a connection failed to greet: not ZeroMQ, no keys where keys are needed, or the wrong ones"
                )
        for fd in self.connections.over_limit():
            self.connections.cut(fd)
            texts.append("a connection was cut: it sends without end what is no message")
        return ended, texts

    def close(self, linger_ms: int) -> None:
        self._end_monitor()
        self._socket.close(linger=linger_ms)
        self.connections.close()

    def _end_monitor(self) -> None:
        self._socket.disable_monitor()
        self._monitor.close(linger=0)  # else the context would wait for it


def _bind(s: zmq.Socket[bytes], address: str) -> None:
    path = address.removeprefix("ipc://")
    if path != address and path not in ("", "*") and _somebody_listens(path):
        raise PortBusy(address, "another program listens there (a second bench?)")
    try:
        s.bind(address)
    except zmq.ZMQError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortBusy(address, "another program listens there (a second bench?)") from error
        raise PortNotFound(address, f"cannot be listened on ({error.strerror})") from error


def _somebody_listens(path: str) -> bool:
    """ZeroMQ would take the path of a living listener away."""
    if not os.path.exists(path):
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, suppress(OSError):
        probe.settimeout(0.2)
        probe.connect(path)
        return True
    return False
