"""One socket to the bench, its keys, and its monitor: handshake done, handshake failed, connection lost.

ZeroMQ reconnects silently, but a bench identifies a client by its connection, so after a loss the client has to say
hello again. Every loss is therefore reported, and the caller opens a new session.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Union

import zmq
from zmq.utils.monitor import recv_monitor_message

from hil_companion.errors import ConnectionLost, OptionError, WrongKeys

SILENT_S = 5  # TCP keep-alive timeout: a machine that is silent for longer counts as lost
RECONNECT_MS = 100
RECONNECT_MAX_MS = 5000
HIGH_WATER = 128  # limit of queued messages; more than the credits that a client can give
BYE_LINGER_MS = 200
MAX_BROKEN_HANDSHAKES = 3  # failures without a stated reason; fewer may come from a bench that is just ending

_EVENTS = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)


KEY_CHARACTERS = 40
_Z85 = frozenset("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#")

PathLike = Union[str, Path]


def read_key(path: PathLike, *, secret: bool) -> bytes:
    """Read the key from a file that `hil keys` wrote: 40 Z85 characters on a line of their own, other lines ignored.

    A line is a key by its length and characters; it may begin with '#' like a comment. As with ssh, a secret key that
    other users can read is refused. Raises OptionError.
    """
    try:
        lines = Path(path).read_text(encoding="ascii").splitlines()
        mode = os.stat(path).st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: no key can be read there ({getattr(error, 'strerror', None) or error})") from error
    if secret and os.name == "posix" and mode & 0o077:
        raise OptionError(f"{path}: a secret key that others can read; chmod 600 {path}")
    found = [line.strip() for line in lines if len(line.strip()) == KEY_CHARACTERS and _Z85.issuperset(line.strip())]
    if len(found) != 1:
        raise OptionError(f"{path}: one key of {KEY_CHARACTERS} characters is needed, {len(found)} found")
    return found[0].encode("ascii")


class Keys:
    """CURVE keys of a client: its own pair and the bench's public key. Raises OptionError."""

    def __init__(self, key: PathLike, bench_key: PathLike) -> None:
        self.secret = read_key(key, secret=True)
        self.bench_public = read_key(bench_key, secret=False)
        try:
            self.public: bytes = zmq.curve_public(self.secret)
        except (zmq.ZMQError, ValueError) as error:
            raise OptionError(f"{key}: not a secret key ({error})") from error

    def apply(self, socket: zmq.Socket[Any]) -> None:
        socket.curve_secretkey = self.secret
        socket.curve_publickey = self.public
        socket.curve_serverkey = self.bench_public


class Connection:
    """A DEALER socket and its monitor."""

    def __init__(self, context: zmq.Context[Any], address: str, keys: Keys | None, max_message_bytes: int) -> None:
        self.address = address
        self.handshakes = 0
        self._keys = keys
        self._broken_handshakes = 0
        self._monitor: zmq.Socket[Any] | None = None
        self.socket = context.socket(zmq.DEALER)
        try:
            for option, value in (
                (zmq.LINGER, 0),
                (zmq.SNDHWM, HIGH_WATER),
                (zmq.RCVHWM, HIGH_WATER),
                (zmq.MAXMSGSIZE, max_message_bytes),
                # ZeroMQ's own heartbeats are off: they can abort the bench's libzmq 4.3 (libzmq issue 4841).
                (zmq.TCP_KEEPALIVE, 1),
                (zmq.TCP_KEEPALIVE_IDLE, 1),
                (zmq.TCP_KEEPALIVE_INTVL, 1),
                (zmq.TCP_KEEPALIVE_CNT, SILENT_S - 1),
                (zmq.TCP_MAXRT, SILENT_S * 1000),
                (zmq.RECONNECT_IVL, RECONNECT_MS),
                (zmq.RECONNECT_IVL_MAX, RECONNECT_MAX_MS),
            ):
                self.socket.setsockopt(option, value)
            if keys is not None:
                keys.apply(self.socket)
            self._monitor = self.socket.get_monitor_socket(_EVENTS)
            self.socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise OptionError(
                f"{address}: not an address to connect to ({error.strerror}); tcp://HOST:PORT or ipc://FILE is needed"
            ) from error

    @property
    def monitor(self) -> zmq.Socket[Any]:
        assert self._monitor is not None
        return self._monitor

    def send(self, message: bytes) -> None:
        try:
            self.socket.send(message, zmq.NOBLOCK)
        except zmq.Again:
            raise ConnectionLost(f"{self.address}: the connection was lost, or the bench reads no messages") from None

    def receive(self) -> list[Any] | None:
        """Return the parts of one waiting message, uncopied; None if no message waits."""
        if not _readable(self.socket):
            return None  # cheaper than the exception below; with several ports most have no message
        try:
            parts: list[Any] = self.socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return None
        return parts

    def watch(self) -> bool:
        """Read the monitor's events; return True if the connection was lost. Raises WrongKeys."""
        lost = False
        while _readable(self.monitor):
            event = recv_monitor_message(self.monitor)
            kind = event["event"]
            if kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self.handshakes += 1
            elif kind == zmq.EVENT_DISCONNECTED:
                lost = lost or self.handshakes > 0
            else:
                self._failed(kind, event["value"])
        return lost

    def _failed(self, kind: int, value: int) -> None:
        if kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
            self._broken_handshakes += 1
            if self._broken_handshakes < MAX_BROKEN_HANDSHAKES:
                return
        if self._keys is None:
            why = "the bench requires keys (--key and --bench-key), or the program there does not speak ZeroMQ"
        elif kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            why = f"the bench does not allow this client's key (status {value}): give it the .pub file"
        else:
            why = "--bench-key is not this bench's public key, or the bench uses no keys"
        raise WrongKeys(f"{self.address}: handshake failed: {why}")

    def close(self, linger_ms: int = 0) -> None:
        if self.socket.closed:
            return
        if self._monitor is not None:
            self.socket.disable_monitor()
            self._monitor.close(linger=0)  # with a linger time, closing the context would wait forever
        self.socket.close(linger=linger_ms)


def _readable(socket: zmq.Socket[Any]) -> bool:
    return bool(int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)
