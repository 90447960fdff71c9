"""ROUTER sockets of the bench: bound, limited, encrypted where there are keys, and monitored for ended connections.

ZeroMQ bounds floods: the size of a message and the number of unread messages of a connection are limited; further
messages stay in the kernel's buffers, and then with their sender. A connection that does not finish its handshake is
closed.

Known limits of libzmq 4.3: a message with an endless number of parts stays in memory until its last part has come. When
a connection breaks whose messages were held back while it sent ZeroMQ's own heartbeats (ZMQ_HEARTBEAT_IVL), an
assertion in stream_engine_base.cpp ends the process (libzmq issue 4841). So neither the bench nor its client library
sends such heartbeats: TCP's keepalive replaces them.
"""

from __future__ import annotations

import errno
import os
import socket
import tempfile
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import zmq
from zmq.auth.thread import ThreadAuthenticator
from zmq.utils.monitor import recv_monitor_message

from firmware_bridge.companion.keys import KeyPair, read_allowed, read_bench_keys
from firmware_bridge.companion.settings import CompanionSettings
from signals.errors import PortBusy, PortNotFound

CONTROL = ""  # group of the socket where clients join; each other group is a sensor with a socket of its own
RECEIVE_HWM = 256  # messages of one connection that wait here unread
_SEND_HWM = 192  # messages to one client: 64 frames, and answers to pings
_HANDSHAKE_MS = 3000
_VANISHED_S = 2  # a machine whose kernel does not answer for so long is lost; a stalled process still answers
_EVENTS = (
    zmq.EVENT_DISCONNECTED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
_MAX_TEXTS = 100
_IPC = "ipc://"
_DOMAIN = "companion"


def group_of(topic: str) -> str:
    """Return the sensor that a topic belongs to, its part before the first slash. A sensor may have its own port."""
    return topic.partition("/")[0]


class Unreachable(Exception):  # never leaves the companion package
    """The peer has disconnected."""


class Received(NamedTuple):
    """A message of a client, or of an unregistered sender."""

    identity: bytes
    fd: int  # of its connection
    raw: memoryview  # part 0
    parts: int
    frame: zmq.Frame  # of part 0, with the properties that ZeroMQ knows

    def property(self, name: str) -> str:
        """Return a property from the handshake, or "" if it has none."""
        try:
            return str(self.frame.get(name))
        except (zmq.ZMQError, KeyError, ValueError):
            return ""


class Sockets:
    """All sockets of a session by group: CONTROL, and with `arrangement: ports` one for each sensor."""

    def __init__(self, settings: CompanionSettings, topics: Sequence[str]) -> None:
        """Bind all sockets. Raise ConfigError (keys), PortBusy or PortNotFound."""
        s = settings
        self.by_group: dict[str, BenchSocket] = {}
        self._poller: zmq.Poller = zmq.Poller()
        self._authenticator: ThreadAuthenticator | None = None
        self._turn = 0
        keys = None if s.keys is None or s.bind.startswith(_IPC) else read_bench_keys(s.keys)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context(io_threads=1)
        try:
            if keys is not None and s.keys is not None:
                allowed = _AllowedKeys(read_allowed(s.keys))
                self._authenticator = ThreadAuthenticator(self._context)
                self._authenticator.start()
                self._authenticator.configure_curve_callback(domain=_DOMAIN, credentials_provider=allowed)
            self._open(CONTROL, s.bind, s, keys, "companion.port=0")
            if s.arrangement == "ports":
                for i, group in enumerate(sorted({group_of(topic) for topic in topics})):
                    port = "*" if s.first_sensor_port is None else str(s.first_sensor_port + i)
                    self._open(group, f"tcp://{s.host}:{port}", s, keys, "companion.sensor_port=null")
        except BaseException:
            self.close(0)
            raise

    def _open(self, group: str, address: str, s: CompanionSettings, keys: KeyPair | None, any_free: str) -> None:
        bound = self.by_group[group] = BenchSocket(self._context, address, s, keys, any_free)
        bound.register(self._poller)

    def in_turn(self) -> list[tuple[str, BenchSocket]]:
        """Return all sockets by group. Each call begins with another one."""
        sockets = list(self.by_group.items())
        self._turn = (self._turn + 1) % len(sockets)
        return sockets[self._turn :] + sockets[: self._turn]

    def wait(self, limit_ms: int) -> None:
        """Wait until a message comes or a connection ends, or the limit has passed."""
        self._poller.poll(limit_ms)

    def close(self, linger_ms: int) -> None:
        """Close all sockets. Messages that wait to be sent get `linger_ms`."""
        for bound in self.by_group.values():
            bound.close(linger_ms)
        self.by_group.clear()
        self._poller = zmq.Poller()
        if self._authenticator is not None:
            with suppress(zmq.ZMQError):
                self._authenticator.stop()
        # Waits for the lingering messages only: `term` would wait for a socket that could not be set up, too.
        self._context.destroy(linger=0)


class _AllowedKeys:
    """The authorized keys. ZeroMQ's handshake calls it from the authenticator's thread (ZAP, RFC 27)."""

    def __init__(self, allowed: Mapping[bytes, str]) -> None:
        self._allowed = frozenset(allowed)

    def callback(self, domain: str, key: bytes) -> bool:
        """Return True if the owner of this public key (Z85) may connect."""
        del domain
        return key in self._allowed


class BenchSocket:
    """A bound ROUTER. `endpoint` is where it listens, with the port that it got. Never waits."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        address: str,
        settings: CompanionSettings,
        keys: KeyPair | None,
        any_free: str,
    ) -> None:
        """`any_free`: the setting by which the bench takes any free port. Raise PortBusy or PortNotFound."""
        self._socket = s = context.socket(zmq.ROUTER)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.ROUTER_MANDATORY, 1),
            (zmq.SNDHWM, _SEND_HWM),
            (zmq.RCVHWM, RECEIVE_HWM),
            (zmq.MAXMSGSIZE, settings.max_message_bytes),
            (zmq.HANDSHAKE_IVL, _HANDSHAKE_MS),
            # The kernel asks whether the other machine is alive: not ZeroMQ's heartbeats, see the module's header.
            (zmq.TCP_KEEPALIVE, 1),
            (zmq.TCP_KEEPALIVE_IDLE, 1),
            (zmq.TCP_KEEPALIVE_INTVL, 1),
            (zmq.TCP_KEEPALIVE_CNT, _VANISHED_S),
            (zmq.TCP_MAXRT, _VANISHED_S * 1000),
            (zmq.IPV6, int(address.startswith("tcp://["))),
        ):
            s.setsockopt(option, value)
        if keys is not None:
            s.curve_server = True
            s.curve_secretkey = keys.secret
            s.curve_publickey = keys.public
            s.zap_domain = _DOMAIN.encode("ascii")
        self._monitor = s.get_monitor_socket(_EVENTS)
        self._folder: Path | None = None
        self._file: Path | None = None
        self._received = 0
        self._ended: deque[tuple[int, int]] = deque()  # descriptor, and `_received` once all its messages are read
        self._texts: list[str] = []
        try:
            self._bind(address, any_free)
        except BaseException:
            self.close(0)
            raise
        self.endpoint = s.getsockopt_string(zmq.LAST_ENDPOINT)

    def _bind(self, address: str, any_free: str) -> None:
        """Bind. `ipc://*` is a file in a new folder. Only the bench's user may open a local socket's file."""
        if address == f"{_IPC}*":
            try:
                self._folder = Path(tempfile.mkdtemp(prefix="hil-companion-")).absolute()
            except OSError as error:
                text = f"cannot hold the socket's file ({error.strerror or error}); set TMPDIR to another folder"
                raise PortNotFound(tempfile.gettempdir(), text) from error
            address = f"{_IPC}{self._folder / 'socket'}"
        text = f"another program listens there (a second bench?); stop it, or use any free one with --set {any_free}"
        busy = PortBusy(address, text)
        if address.startswith(_IPC) and _has_listener(address.removeprefix(_IPC)):
            raise busy
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            if error.errno == errno.EADDRINUSE:
                raise busy from error
            raise PortNotFound(
                address, f"cannot be listened on ({error.strerror}); is it an address of this machine?"
            ) from error
        if address.startswith(_IPC):
            self._file = Path(address.removeprefix(_IPC))
            with suppress(OSError):  # an abstract name has no file
                self._file.chmod(0o600)

    def register(self, poller: zmq.Poller) -> None:
        """Register with `poller`, which then wakes at messages and at ended connections."""
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._monitor, zmq.POLLIN)

    def receive(self) -> Received | None:
        """Return the next message, or None."""
        if not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            self._ended = deque((fd, 0) for fd, _ in self._ended)  # none of their messages are left
            return None  # checked first: most sockets are silent most of the time, and an exception costs more
        try:
            parts = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return None
        self._received += 1
        last = parts[-1]
        fd = _descriptor(last) if len(parts) > 1 else -1
        first = parts[1] if len(parts) > 1 else last
        return Received(parts[0].bytes, fd, first.buffer, len(parts) - 1, first)

    def send(self, identity: bytes, parts: Sequence[bytes | zmq.Frame]) -> bool:
        """Return False if the send buffer is full. Unreachable if the peer has disconnected."""
        try:
            self._socket.send_multipart([identity, *parts], zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return False
        except zmq.ZMQError as error:
            if error.errno == zmq.EHOSTUNREACH:
                raise Unreachable from None
            raise
        return True

    def ended(self, others: int, *, at_once: bool = False) -> list[int]:
        """Return descriptors of ended connections, once all their messages have been received, or `at_once`.

        `others`: number of other connections. ZeroMQ reads all connections in turn, so no message of an ended one is
        left after RECEIVE_HWM rounds, or as soon as no message is left at all.
        """
        while int(self._monitor.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            event = recv_monitor_message(self._monitor, zmq.NOBLOCK)
            if event["event"] == zmq.EVENT_DISCONNECTED:
                self._ended.append((event["value"], self._received + RECEIVE_HWM * (others + 1)))
            elif event["event"] == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self._text(
                    "a client was refused: its key is not among the allowed ones; is its .pub in the key folder?"
                )
            else:
                self._text("a connection failed in the handshake: not ZeroMQ, or without the right keys")
        found = []
        while self._ended and (at_once or self._ended[0][1] <= self._received):
            found.append(self._ended.popleft()[0])
        return found

    def texts(self) -> list[str]:
        """Return the descriptions of failed connections since the last call."""
        texts, self._texts = self._texts, []
        return texts

    def _text(self, text: str) -> None:
        if len(self._texts) < _MAX_TEXTS:
            self._texts.append(text)

    def close(self, linger_ms: int) -> None:
        self._socket.disable_monitor()
        self._monitor.close(linger=0)  # otherwise the context waits for it
        # Before the socket closes: no other bench can have bound the path while it still listens.
        with suppress(OSError):
            if self._file is not None:
                self._file.unlink()
        with suppress(OSError):
            if self._folder is not None:
                self._folder.rmdir()
        self._socket.close(linger=linger_ms)


def _descriptor(frame: zmq.Frame) -> int:
    """Return the descriptor of the connection that a message came by; -1 if ZeroMQ states none, as for ZMTP 1.0."""
    try:
        return int(frame.get(zmq.SRCFD))
    except zmq.ZMQError:
        return -1


def _has_listener(path: str) -> bool:
    """Return True if a program listens on this path. ZeroMQ would take the path over without an error."""
    if not os.path.exists(path):
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, suppress(OSError):
        probe.settimeout(0.2)
        probe.connect(path)
        return True
    return False
