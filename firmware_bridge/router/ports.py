"""The router's clients and sockets: bytes in and out, per client. No call here waits."""

from __future__ import annotations

import errno
import select
import socket
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser, datagrams
from firmware_bridge.router.endpoint import Address, Endpoint
from signals.errors import PortBusy, PortNotFound
from signals.time import NS_PER_S

_DATAGRAMS_PER_TICK = 32
_DATAGRAM_SIZE = 65536
_BYTES_PER_TICK = 65536  # read from one socket
_TCP_BACKLOG_LIMIT = 256 * 1024  # unread telemetry of one client; past it the client has stalled
_TCP_SEND_BUFFER = 128 * 1024
_CLIENTS_LIMIT = 16  # per endpoint
_FORGET_NS = 60 * NS_PER_S  # a client that has been silent for so long may be replaced by a new one

# Limits of one client towards the autopilot: a flood costs only the client that sends it.
_QUEUE_LIMIT = 16384
_SYSTEMS_LIMIT = 32


class Client:
    """One client: its systems, and its frames that still wait for the autopilot.

    Made when its first bytes come; `active` from its first accepted frame on.
    """

    __slots__ = ("_queue", "_queued_bytes", "active", "last_frame_ns", "name", "parser", "systems")

    def __init__(self, name: str) -> None:
        self.name = name
        # Its own parser: parts of its frames must not mix with those of another client.
        self.parser = FrameParser()
        self.systems: dict[int, set[int]] = {}  # system -> its components
        self.last_frame_ns = 0  # wall clock
        self.active = False
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0

    @property
    def queued_bytes(self) -> int:
        return self._queued_bytes

    def learn(self, frame: Frame) -> None:
        """Note the frame's system as one of this client. Past a limit the oldest entry is dropped."""
        components = self.systems.get(frame.sysid)
        if components is None:
            if len(self.systems) >= _SYSTEMS_LIMIT:
                del self.systems[next(iter(self.systems))]
            components = self.systems[frame.sysid] = set()
        components.add(frame.compid)

    def is_addressed(self, system: int, component: int) -> bool:
        """Return True for a broadcast, and for a message to one of this client's systems."""
        if not system:
            return True
        components = self.systems.get(system)
        return components is not None and (not component or component in components)

    def enqueue(self, raw: bytes) -> bool:
        """Queue a frame for the autopilot. Return False if the queue is full."""
        if self._queued_bytes + len(raw) > _QUEUE_LIMIT:
            return False
        self._queue.append(raw)
        self._queued_bytes += len(raw)
        return True

    def take(self, limit: int) -> bytes | None:
        """Return the next frame for the autopilot, or None if there is none of at most `limit` bytes."""
        if not self._queue or len(self._queue[0]) > limit:
            return None
        raw = self._queue.popleft()
        self._queued_bytes -= len(raw)
        return raw


OnReceived = Callable[[Client, bytes], None]


class SocketPoller:
    """Polls sockets for incoming data and calls the reader of each."""

    def __init__(self) -> None:
        self._poll = select.poll()
        self._readers: dict[int, Callable[[], None]] = {}

    def add(self, sock: socket.socket, reader: Callable[[], None]) -> None:
        self._readers[sock.fileno()] = reader
        self._poll.register(sock, select.POLLIN)

    def remove(self, sock: socket.socket) -> None:
        with suppress(KeyError, ValueError, OSError):
            self._poll.unregister(sock)
        self._readers.pop(sock.fileno(), None)

    def serve(self) -> None:
        """Call the reader of every socket that has data."""
        for fd, _ in self._poll.poll(0):
            reader = self._readers.get(fd)
            if reader is not None:  # else an earlier reader of this round has closed it
                reader()


class Port(Protocol):
    """One endpoint in use."""

    endpoint: Endpoint
    address: Address

    turned_away: int

    def clients(self) -> Iterable[Client]: ...
    def send(self, client: Client, raws: Sequence[bytes]) -> int:
        """Send frames. Return how many were lost."""
        ...

    def announce(self, raws: Sequence[bytes]) -> int:
        """Send to a client that has not sent a frame yet. Return how many frames went out."""
        ...

    def close(self) -> None: ...


class UdpPort:
    """A UDP socket. Where the endpoint has a remote, datagrams from other machines are refused."""

    def __init__(
        self, endpoint: Endpoint, poller: SocketPoller, on_received: OnReceived, clock_ns: Callable[[], int]
    ) -> None:
        self.endpoint = endpoint
        self._poller, self._on_received, self._clock_ns = poller, on_received, clock_ns
        self._clients: dict[Address, Client] = {}
        self.turned_away = 0  # datagrams from too many clients, or from another machine than the endpoint's
        self._remote = None if endpoint.remote is None else _resolved(endpoint.remote)
        self._socket = _bound(endpoint, socket.SOCK_DGRAM, self._remote)
        self.address: Address = self._socket.getsockname()
        poller.add(self._socket, self._read)

    def clients(self) -> Iterable[Client]:
        return self._clients.values()

    def send(self, client: Client, raws: Sequence[bytes]) -> int:
        address = next((at for at, known in self._clients.items() if known is client), None)
        return len(raws) if address is None else self._send(address, raws)

    def announce(self, raws: Sequence[bytes]) -> int:
        if self._remote is None:
            return 0
        client = self._clients.get(self._remote)
        if client is not None and client.active:
            return 0
        return len(raws) - self._send(self._remote, raws)

    def _send(self, address: Address, raws: Sequence[bytes]) -> int:
        lost = 0
        for datagram, count in datagrams(raws):
            try:
                self._socket.sendto(datagram, address)
            except OSError:
                lost += count  # full buffer, no listener, no route: lost telemetry must not end a run
        return lost

    def _read(self) -> None:
        left = _BYTES_PER_TICK
        for _ in range(_DATAGRAMS_PER_TICK):
            try:
                data, sender = self._socket.recvfrom(_DATAGRAM_SIZE)
            except BlockingIOError:
                return
            except OSError:
                continue  # an ICMP report about an earlier datagram
            client = self._clients.get(sender)
            if client is None:
                if self._remote is not None and sender[0] != self._remote[0]:
                    self.turned_away += 1
                    continue
                # Full, and no client has been silent for long enough to be replaced.
                if len(self._clients) >= _CLIENTS_LIMIT and self._replaceable() is None:
                    self.turned_away += 1
                    continue
                client = Client(f"{self.endpoint.name} {sender[0]}:{sender[1]}")
            self._on_received(client, data)
            if client.active and sender not in self._clients:
                if len(self._clients) >= _CLIENTS_LIMIT:
                    self._clients.pop(self._replaceable() or sender, None)
                self._clients[sender] = client
            left -= len(data)
            if left <= 0:
                return

    def _replaceable(self) -> Address | None:
        """Return the client that has been silent longest, if a new one may replace it."""
        address, oldest = min(self._clients.items(), key=lambda item: item[1].last_frame_ns)
        return address if self._clock_ns() - oldest.last_frame_ns >= _FORGET_NS else None

    def close(self) -> None:
        self._poller.remove(self._socket)
        self._socket.close()
        self._clients.clear()


class _Connection:
    """One TCP client and the bytes that it has not read yet."""

    __slots__ = ("backlog", "client", "socket")

    def __init__(self, sock: socket.socket, client: Client) -> None:
        self.socket, self.client = sock, client
        self.backlog = bytearray()


class TcpPort:
    """A TCP server. It disconnects a client that leaves too much unread."""

    def __init__(
        self,
        endpoint: Endpoint,
        poller: SocketPoller,
        on_received: OnReceived,
        on_closed: Callable[[Client, str], None],
    ) -> None:
        self.endpoint = endpoint
        self._poller, self._on_received, self._on_closed = poller, on_received, on_closed
        self._connections: dict[int, _Connection] = {}  # by descriptor
        self.turned_away = 0
        self._listener = _bound(endpoint, socket.SOCK_STREAM, None)
        self._listener.listen(_CLIENTS_LIMIT)
        self.address: Address = self._listener.getsockname()
        poller.add(self._listener, self._accept)

    def clients(self) -> Iterable[Client]:
        return [connection.client for connection in self._connections.values()]

    def send(self, client: Client, raws: Sequence[bytes]) -> int:
        for connection in list(self._connections.values()):
            if connection.client is client:
                connection.backlog += b"".join(raws)
                self._push(connection)
                return 0
        return len(raws)

    def announce(self, raws: Sequence[bytes]) -> int:
        """Send to connected clients that have not sent a frame: many wait for a heartbeat first."""
        sent = 0
        for connection in list(self._connections.values()):
            if not connection.client.active:
                connection.backlog += b"".join(raws)
                self._push(connection)
                sent += len(raws)
        return sent

    def _push(self, connection: _Connection) -> None:
        try:
            sent = connection.socket.send(connection.backlog)
            del connection.backlog[:sent]
        except BlockingIOError:
            pass
        except OSError as error:
            self._disconnect(connection, f"connection lost ({error.strerror})")
            return
        if len(connection.backlog) > _TCP_BACKLOG_LIMIT:
            self._disconnect(connection, f"stalled: {len(connection.backlog)} bytes unread; disconnected")

    def _accept(self) -> None:
        while True:
            try:
                sock, sender = self._listener.accept()
            except OSError:
                return
            if len(self._connections) >= _CLIENTS_LIMIT:
                self.turned_away += 1
                sock.close()
                continue
            sock.setblocking(False)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _TCP_SEND_BUFFER)
            connection = _Connection(sock, Client(f"{self.endpoint.name} tcp {sender[0]}:{sender[1]}"))
            self._connections[sock.fileno()] = connection
            self._poller.add(sock, partial(self._read, connection))

    def _read(self, connection: _Connection) -> None:
        try:
            data = connection.socket.recv(_BYTES_PER_TICK)
        except BlockingIOError:
            return
        except OSError as error:
            self._disconnect(connection, f"connection lost ({error.strerror})")
            return
        if data:
            self._on_received(connection.client, data)
        else:
            self._disconnect(connection, "left")

    def _disconnect(self, connection: _Connection, why: str) -> None:
        if self._connections.pop(connection.socket.fileno(), None) is None:
            return
        self._poller.remove(connection.socket)
        connection.socket.close()
        self._on_closed(connection.client, why)

    def close(self) -> None:
        for connection in self._connections.values():
            self._poller.remove(connection.socket)
            connection.socket.close()
        self._connections.clear()
        self._poller.remove(self._listener)
        self._listener.close()


def _bound(endpoint: Endpoint, kind: int, remote: Address | None) -> socket.socket:
    """Return a non-blocking socket at the endpoint's local address. PortBusy or PortNotFound if it cannot be bound."""
    host, port = endpoint.local
    named = remote if remote is not None and not host else endpoint.local
    name = f"{'tcp' if endpoint.tcp else 'udp'} {named[0]}:{named[1]}"
    sock = socket.socket(socket.AF_INET, kind)
    try:
        if not host and remote is not None:
            host = _own_host(remote)
        if endpoint.tcp:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port that the last run has just released
        sock.bind((host, port))
    except (OSError, OverflowError) as error:
        sock.close()
        if port and getattr(error, "errno", None) == errno.EADDRINUSE:
            raise PortBusy(
                name, "another program has this port (another run?); stop it, or choose another port in `router`"
            ) from error
        raise PortNotFound(
            name, f"cannot be bound on this machine ({error}); choose one of its addresses in `router`"
        ) from error
    sock.setblocking(False)
    return sock


def _own_host(remote: Address) -> str:
    """Return this machine's address towards `remote`, without sending anything."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(remote)
        return str(probe.getsockname()[0])


def _resolved(address: Address) -> Address:
    try:
        return (socket.gethostbyname(address[0]), address[1])
    except OSError as error:
        raise PortNotFound(
            f"udp {address[0]}:{address[1]}", f"no such machine ({error}); is the name in `router` right?"
        ) from error
