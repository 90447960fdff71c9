"""One ROUTER socket of the bench: bound, limited, encrypted where it has keys, and told who has gone. Never waits.

Two features of ZeroMQ are left alone. libzmq 4.3 ends the whole process (an assertion in stream_engine_base.cpp, its
issue 4841) when it writes a heartbeat to a connection that broke while its input was held back by the receiving
high-water mark. So the bench sends no heartbeats, TCP's keepalive takes their place; and since a client's own
heartbeats are answered the same way, input over TCP has no high-water mark: `Connections` counts bytes and cuts those
who flood.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import zmq
from zmq.utils.monitor import recv_monitor_message

from firmware_bridge.companion.binding import Binding
from firmware_bridge.companion.connections import Connections
from firmware_bridge.companion.doorkeeper import DOMAIN
from firmware_bridge.companion.keys import KeyPair
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.unreachable import Unreachable

_SEND_HWM = 192  # messages to one client: 64 frames, and answers to pings
# Of TCP, bytes are counted (`Connections`). The kernel counts none of a local socket: there, messages are limited in
# number and size. Parts of a message without end are not; only processes of the bench's own user could send it one.
_IPC_RECEIVE_HWM = 256  # messages of one client that wait here
_IPC_BYTES = 64 << 10  # of one part
_HANDSHAKE_MS = 3000
_EVENTS = (
    zmq.EVENT_ACCEPTED
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
_CONNECTIONS_PER_CLIENT = 4
_TEXTS = 100


class Received(NamedTuple):
    """A message of a client, or of a stranger."""

    identity: bytes
    fd: int  # of its connection
    raw: memoryview  # part 0
    parts: int
    frame: zmq.Frame  # of part 0, for what else ZeroMQ knows


class BenchSocket:
    """A bound ROUTER. `endpoint` is where it listens, with the port that it got."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        address: str,
        settings: CompanionSettings,
        keys: KeyPair | None,
        *,
        any_free: str = "companion.port=0",
    ) -> None:
        """`any_free`: the setting that a person is told of where the address is taken."""
        self._socket = context.socket(zmq.ROUTER)
        s = self._socket
        s.setsockopt(zmq.LINGER, 0)
        s.setsockopt(zmq.ROUTER_MANDATORY, 1)
        s.setsockopt(zmq.SNDHWM, _SEND_HWM)
        tcp = address.startswith("tcp://")
        s.setsockopt(zmq.RCVHWM, 0 if tcp else _IPC_RECEIVE_HWM)
        s.setsockopt(zmq.MAXMSGSIZE, settings.max_message_bytes if tcp else min(settings.max_message_bytes, _IPC_BYTES))
        s.setsockopt(zmq.HANDSHAKE_IVL, _HANDSHAKE_MS)
        # The kernel asks whether the other machine is alive. Not ZeroMQ's heartbeats, see the module's header.
        s.setsockopt(zmq.TCP_KEEPALIVE, 1)
        s.setsockopt(zmq.TCP_KEEPALIVE_IDLE, 1)
        s.setsockopt(zmq.TCP_KEEPALIVE_INTVL, 1)
        s.setsockopt(zmq.TCP_KEEPALIVE_CNT, settings.vanished_s)
        s.setsockopt(zmq.TCP_MAXRT, settings.vanished_s * 1000)
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
            self._binding = Binding(s, address, any_free)
        except BaseException:
            self._end_monitor()
            s.close()
            raise
        self.endpoint = self._binding.endpoint
        self._lock = threading.Lock()  # of the monitor and the connections: the sentry looks too
        self._ended: list[int] = []
        self._texts: list[str] = []

    def register(self, poller: zmq.Poller) -> None:
        """Only what the caller's thread alone uses; the monitor is read under a lock."""
        poller.register(self._socket, zmq.POLLIN)

    def fileno(self) -> int:
        """Of what becomes readable when something has come; a change only, told once: `receive` first."""
        return int(self._socket.getsockopt(zmq.FD))

    def receive(self) -> Received | None:
        """The next message; None while there is none."""
        if not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            return None  # asked first: an exception costs more, and most sockets are silent most of the time
        try:
            parts = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return None
        last = parts[-1]
        fd = int(last.get(zmq.SRCFD)) if len(parts) > 1 else -1
        with self._lock:
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
        with self._lock:
            self._look()
            ended, self._ended = self._ended, []
            texts, self._texts = self._texts, []
        return ended, texts

    def cut(self, fd: int) -> None:
        """End a connection; `gone` will tell."""
        with self._lock:
            self.connections.cut(fd)

    def look(self) -> None:
        """See who came and went, and cut who floods. From any thread."""
        with self._lock:
            self._look()

    def _look(self) -> None:
        while int(self._monitor.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            event = recv_monitor_message(self._monitor, zmq.NOBLOCK)
            kind, value = event["event"], event["value"]
            if kind == zmq.EVENT_ACCEPTED:
                why = self.connections.accepted(value)
                if why is not None:
                    self._text(why)
            elif kind == zmq.EVENT_DISCONNECTED:
                self.connections.gone(value)
                self._ended.append(value)
            elif kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self._text("a client was turned away: its key is not among the allowed ones")
            else:
                self._text("a connection failed to greet: not ZeroMQ, or without the right keys")
        for fd in self.connections.over_limit():
            self.connections.cut(fd)
            self._text("a connection was cut: it sends more than is read, or a message without end")

    def _text(self, text: str) -> None:
        if len(self._texts) < _TEXTS:
            self._texts.append(text)

    def close(self, linger_ms: int) -> None:
        self._end_monitor()
        self._binding.remove()
        self._socket.close(linger=linger_ms)
        self.connections.close()

    def _end_monitor(self) -> None:
        self._socket.disable_monitor()
        self._monitor.close(linger=0)  # else the context would wait for it
