"""The router's clients and sockets: bytes in and out, per client. Nothing here waits."""

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
from firmware_bridge.router_endpoint import Address, Endpoint
from hil.signals.errors import PortBusy, PortNotFound
from hil.signals.time import NS_PER_S

_DATAGRAMS_PER_TICK = 32
_DATAGRAM_SIZE = 65536
_BYTES_PER_TICK = 65536  # read from one socket
_TCP_BACKLOG_LIMIT = 256 * 1024  # unread telemetry of one client; past it the client has stalled
_TCP_SEND_BUFFER = 128 * 1024
_CLIENTS_LIMIT = 16  # per endpoint
_FORGET_NS = 60 * NS_PER_S  # a place may be taken over from a client that has said nothing for so long

# Of one client towards the autopilot: a flood costs its sender, and nobody else.
_QUEUE_LIMIT = 16384
_SYSTEMS_LIMIT = 32


class Client:
    """What one client has said, from which systems, and what of it still waits for the autopilot.

    Made when the first bytes come; counts as one (`spoken`) from its first admitted frame on.
    """

    __slots__ = ("_queue", "_queued_bytes", "heard_ns", "name", "parser", "refused", "spoken", "systems")

    def __init__(self, name: str) -> None:
        self.name = name
        # A parser each: half a frame of one must not meet half a frame of another.
        self.parser = FrameParser()
        self.systems: dict[int, set[int]] = {}  # system -> its components heard here
        self.heard_ns = 0  # wall clock
        self.spoken = False
        self.refused: set[str] = set()  # reasons of which an event has told
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0

    @property
    def queued_bytes(self) -> int:
        return self._queued_bytes

    def learn(self, frame: Frame) -> None:
        """A system speaks here. Past a bound the oldest knowledge goes: nobody has that many systems."""
        components = self.systems.get(frame.sysid)
        if components is None:
            if len(self.systems) >= _SYSTEMS_LIMIT:
                del self.systems[next(iter(self.systems))]
            components = self.systems[frame.sysid] = set()
        components.add(frame.compid)

    def wants(self, system: int, component: int) -> bool:
        """Whether a message addressed like this belongs here: everybody's, or that of a system heard here."""
        if not system:
            return True
        components = self.systems.get(system)
        return components is not None and (not component or component in components)

    def enqueue(self, raw: bytes) -> bool:
        """Keep for the autopilot; False where there is no room."""
        if self._queued_bytes + len(raw) > _QUEUE_LIMIT:
            return False
        self._queue.append(raw)
        self._queued_bytes += len(raw)
        return True

    def take(self, room: int) -> bytes | None:
        """The next frame for the autopilot, if there is one and it fits."""
        if not self._queue or len(self._queue[0]) > room:
            return None
        raw = self._queue.popleft()
        self._queued_bytes -= len(raw)
        return raw


Heard = Callable[[Client, bytes], None]


class Watch:
    """Sockets that may have something to read, each with who reads it."""

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
        """Let every socket that has something be read."""
        for fd, _ in self._poll.poll(0):
            reader = self._readers.get(fd)
            if reader is not None:  # closed by an earlier one of this very round
                reader()


class Port(Protocol):
    """One endpoint in use."""

    endpoint: Endpoint
    address: Address

    turned_away: int

    def clients(self) -> Iterable[Client]: ...
    def send(self, client: Client, raws: Sequence[bytes]) -> int:
        """Send frames; how many of them found no room."""
        ...

    def announce(self, raws: Sequence[bytes]) -> int:
        """Send to where a client is expected that has not spoken yet; how many frames went."""
        ...

    def close(self) -> None: ...


class UdpPort:
    """A UDP socket. Where the endpoint has a remote, only that machine is listened to."""

    def __init__(self, endpoint: Endpoint, watch: Watch, heard: Heard, clock_ns: Callable[[], int]) -> None:
        self.endpoint = endpoint
        self._watch, self._heard, self._clock_ns = watch, heard, clock_ns
        self._clients: dict[Address, Client] = {}
        self.turned_away = 0  # datagrams for which there was no place, or from a machine not asked for
        self._remote = None if endpoint.remote is None else _resolved(endpoint.remote)
        self._socket = _bound(endpoint, socket.SOCK_DGRAM, self._remote)
        self.address: Address = self._socket.getsockname()
        watch.add(self._socket, self._read)

    def clients(self) -> Iterable[Client]:
        return self._clients.values()

    def send(self, client: Client, raws: Sequence[bytes]) -> int:
        address = next((at for at, known in self._clients.items() if known is client), None)
        return len(raws) if address is None else self._send(address, raws)

    def announce(self, raws: Sequence[bytes]) -> int:
        if self._remote is None:
            return 0
        client = self._clients.get(self._remote)
        if client is not None and client.spoken:
            return 0
        return len(raws) - self._send(self._remote, raws)

    def _send(self, address: Address, raws: Sequence[bytes]) -> int:
        lost = 0
        for datagram, count in datagrams(raws):
            try:
                self._socket.sendto(datagram, address)
            except OSError:
                lost += count  # no room in the socket, nobody there, no route: telemetry is not worth a run
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
                # Full, and nobody has been silent for long enough: not even looked at.
                if len(self._clients) >= _CLIENTS_LIMIT and self._silent_longest() is None:
                    self.turned_away += 1
                    continue
                client = Client(f"{self.endpoint.name} {sender[0]}:{sender[1]}")
            self._heard(client, data)
            if client.spoken and sender not in self._clients:
                if len(self._clients) >= _CLIENTS_LIMIT:
                    self._clients.pop(self._silent_longest() or sender, None)
                self._clients[sender] = client
            left -= len(data)
            if left <= 0:
                return

    def _silent_longest(self) -> Address | None:
        """Whose place may be taken over."""
        address, oldest = min(self._clients.items(), key=lambda item: item[1].heard_ns)
        return address if self._clock_ns() - oldest.heard_ns >= _FORGET_NS else None

    def close(self) -> None:
        self._watch.remove(self._socket)
        self._socket.close()
        self._clients.clear()


class _Connection:
    """One TCP client and what it has not read yet."""

    __slots__ = ("backlog", "client", "socket")

    def __init__(self, sock: socket.socket, client: Client) -> None:
        self.socket, self.client = sock, client
        self.backlog = bytearray()


class TcpPort:
    """A TCP server. A client that leaves too much unread has stalled and is hung up on."""

    def __init__(self, endpoint: Endpoint, watch: Watch, heard: Heard, gone: Callable[[Client, str], None]) -> None:
        self.endpoint = endpoint
        self._watch, self._heard, self._gone = watch, heard, gone
        self._connections: dict[int, _Connection] = {}  # by descriptor
        self.turned_away = 0
        self._listener = _bound(endpoint, socket.SOCK_STREAM, None)
        self._listener.listen(_CLIENTS_LIMIT)
        self.address: Address = self._listener.getsockname()
        watch.add(self._listener, self._accept)

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
        """Whoever has connected is found already, but many wait for a heartbeat before they speak."""
        sent = 0
        for connection in list(self._connections.values()):
            if not connection.client.spoken:
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
            self._hang_up(connection, f"gone ({error.strerror})")
            return
        if len(connection.backlog) > _TCP_BACKLOG_LIMIT:
            self._hang_up(connection, f"stalled: {len(connection.backlog)} bytes unread, hung up on")

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
            self._watch.add(sock, partial(self._read, connection))

    def _read(self, connection: _Connection) -> None:
        try:
            data = connection.socket.recv(_BYTES_PER_TICK)
        except BlockingIOError:
            return
        except OSError as error:
            self._hang_up(connection, f"gone ({error.strerror})")
            return
        if data:
            self._heard(connection.client, data)
        else:
            self._hang_up(connection, "left")

    def _hang_up(self, connection: _Connection, why: str) -> None:
        if self._connections.pop(connection.socket.fileno(), None) is None:
            return
        self._watch.remove(connection.socket)
        connection.socket.close()
        self._gone(connection.client, why)

    def close(self) -> None:
        for connection in self._connections.values():
            self._watch.remove(connection.socket)
            connection.socket.close()
        self._connections.clear()
        self._watch.remove(self._listener)
        self._listener.close()


def _bound(endpoint: Endpoint, kind: int, remote: Address | None) -> socket.socket:
    """A non-blocking socket at the endpoint's local address. PortBusy or PortNotFound where it cannot be had."""
    host, port = endpoint.local
    named = remote if remote is not None and not host else endpoint.local
    name = f"{'tcp' if endpoint.tcp else 'udp'} {named[0]}:{named[1]}"
    sock = socket.socket(socket.AF_INET, kind)
    try:
        if not host and remote is not None:
            host = _own_host(remote)
        if endpoint.tcp:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port whose last run has just ended
        sock.bind((host, port))
    except (OSError, OverflowError) as error:
        sock.close()
        if port and getattr(error, "errno", None) == errno.EADDRINUSE:
            raise PortBusy(name, "another program has this port (another run?); stop it or route elsewhere") from error
        raise PortNotFound(name, f"cannot be bound on this machine ({error})") from error
    sock.setblocking(False)
    return sock


def _own_host(remote: Address) -> str:
    """This machine's address towards `remote`. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(remote)
        return str(probe.getsockname()[0])


def _resolved(address: Address) -> Address:
    try:
        return (socket.gethostbyname(address[0]), address[1])
    except OSError as error:
        raise PortNotFound(f"udp {address[0]}:{address[1]}", f"no such machine ({error})") from error
