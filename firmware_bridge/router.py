"""Lets ground stations and SDKs on UDP see the autopilot and talk to it, as PX4 does.

What the autopilot says, except the HIL messages, goes out to every client; what clients say is checked
frame by frame and joins the bench's write of the next tick. Nothing here waits: a client that floods,
stalls or talks nonsense costs a bounded amount of time and is counted.

A client runs on wall-clock time, so its first frame makes a run no longer repeatable: `received_any`.
"""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from firmware_bridge.codecs.messages import MSGID
from hil.signals.errors import LinkClosed, PortBusy, PortNotFound

Address = tuple[str, int]

_HEARTBEAT = MSGID["HEARTBEAT"]
# The bench's own conversation with the autopilot: neither shown to clients nor taken from them.
HIL_FAMILY = frozenset(msgid for name, msgid in MSGID.items() if name.startswith("HIL_"))

_DATAGRAM_LIMIT = 1400  # of whole frames, below any MTU
_DATAGRAMS_PER_TICK = 32
_BYTES_PER_TICK = 2048  # to the autopilot: at 921600 baud a 4 ms tick has room for 368 bytes, at USB speed for more
_QUEUE_LIMIT = 65536
_CLIENTS_LIMIT = 16
_DATAGRAM_SIZE = 65536


class Endpoint(NamedTuple):
    """Clients that listen on `remote` hear the autopilot; they and others may talk to it at `local`."""

    remote: Address
    local: Address = ("127.0.0.1", 0)  # port 0: any free one


# Where PX4's ground stations (QGroundControl) and SDKs (MAVSDK) listen.
PX4_ENDPOINTS = (Endpoint(("127.0.0.1", 14550)), Endpoint(("127.0.0.1", 14540)))


@dataclass
class RouterStats:
    """Frames since `open`."""

    to_clients: int = 0
    from_clients: int = 0
    rejected: int = 0  # HIL messages from clients
    damaged_bytes: int = 0  # bytes from clients that were no frame of the dialect
    dropped: int = 0  # frames for which there was no room, to or from clients
    clients: int = 0


class _Side:
    """One endpoint's socket and the clients it has heard."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        name = f"udp {endpoint.local[0]}:{endpoint.local[1]}"
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind(endpoint.local)
        except (OSError, OverflowError) as error:
            self.socket.close()
            if endpoint.local[1] and getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortBusy(
                    name, "another program has this port (another run?); stop it or route elsewhere"
                ) from error
            raise PortNotFound(name, f"cannot be bound on this machine ({error})") from error
        self.socket.setblocking(False)
        self.address: Address = self.socket.getsockname()
        # In order of arrival. A parser each: half a frame of one must not meet half a frame of another.
        self.clients: dict[Address, FrameParser] = {}

    def targets(self) -> list[Address]:
        """The address always sent to, and the clients that spoke from elsewhere."""
        remote = self.endpoint.remote
        return [remote, *(client for client in self.clients if client != remote)]


class Router:
    """UDP endpoints for clients. Per tick: `collect` what they said, and `forward` what the autopilot said.

    Until a client has spoken, only heartbeats go out to an endpoint: enough to be found by, and nearly free.
    """

    def __init__(self, endpoints: Sequence[Endpoint] = PX4_ENDPOINTS) -> None:
        self._endpoints = tuple(endpoints)
        self._sides: list[_Side] = []
        self._by_fd: dict[int, _Side] = {}
        self._poll = select.poll()
        self._queue: list[bytes] = []
        self._queued_bytes = 0
        self.stats = RouterStats()
        self.received_any = False

    def open(self) -> None:
        """Bind every endpoint. PortBusy or PortNotFound name the one that cannot be."""
        self.close()
        self.stats = RouterStats()
        self.received_any = False
        try:
            for endpoint in self._endpoints:
                side = _Side(endpoint)
                self._sides.append(side)
                self._by_fd[side.socket.fileno()] = side
                self._poll.register(side.socket, select.POLLIN)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        for side in self._sides:
            self._poll.unregister(side.socket)
            side.socket.close()
        self._sides, self._by_fd = [], {}
        self._queue, self._queued_bytes = [], 0

    @property
    def local_addresses(self) -> list[Address]:
        """Where clients may send to, one address per endpoint."""
        return [side.address for side in self._sides]

    def forward(self, frames: Sequence[Frame]) -> None:
        """Send the autopilot's `frames`, except HIL messages, to the clients. Never waits."""
        everything = [frame.raw for frame in frames if frame[0] not in HIL_FAMILY]
        if not everything:
            return
        heartbeats: list[bytes] | None = None
        for side in self._sides:
            if side.clients:
                raws = everything
            else:
                if heartbeats is None:
                    heartbeats = [frame.raw for frame in frames if frame[0] == _HEARTBEAT]
                raws = heartbeats
            if raws:
                self._send(side, raws)

    def _send(self, side: _Side, raws: list[bytes]) -> None:
        targets = side.targets()
        for datagram, count in _datagrams(raws):
            for target in targets:
                try:
                    side.socket.sendto(datagram, target)
                    self.stats.to_clients += count
                except OSError:
                    # No room in the socket, nobody there, no route: telemetry is not worth a run.
                    self.stats.dropped += count

    def collect(self) -> bytes:
        """Whole frames from clients, in order of arrival, for this tick's write. Never waits."""
        for fd, _ in self._poll.poll(0):
            side = self._by_fd.get(fd)
            if side is None:
                raise LinkClosed("router", "was closed while in use")
            self._receive(side)
        return self._take() if self._queue else b""

    def _receive(self, side: _Side) -> None:
        for _ in range(_DATAGRAMS_PER_TICK):
            try:
                data, sender = side.socket.recvfrom(_DATAGRAM_SIZE)
            except BlockingIOError:
                return
            except OSError:
                continue  # an ICMP report about an earlier datagram
            parser = side.clients.get(sender)
            if parser is None:
                parser = FrameParser()
            garbage = parser.garbage_bytes
            frames = parser.feed(data)
            self.stats.damaged_bytes += parser.garbage_bytes - garbage
            if frames and sender not in side.clients:
                if len(side.clients) >= _CLIENTS_LIMIT:
                    self.stats.dropped += len(frames)
                    continue
                side.clients[sender] = parser
                self.stats.clients += 1
            for frame in frames:
                self._enqueue(frame)

    def _enqueue(self, frame: Frame) -> None:
        self.received_any = True
        if frame.msgid in HIL_FAMILY:
            self.stats.rejected += 1
        elif self._queued_bytes + len(frame.raw) > _QUEUE_LIMIT:
            self.stats.dropped += 1
        else:
            self.stats.from_clients += 1
            self._queue.append(frame.raw)
            self._queued_bytes += len(frame.raw)

    def _take(self) -> bytes:
        size = count = 0
        for raw in self._queue:
            if size + len(raw) > _BYTES_PER_TICK:
                break
            size += len(raw)
            count += 1
        data = b"".join(self._queue[:count])
        del self._queue[:count]
        self._queued_bytes -= size
        return data


def _datagrams(raws: list[bytes]) -> Iterable[tuple[bytes, int]]:
    """Frames packed into datagrams: (bytes, number of frames)."""
    batch: list[bytes] = []
    size = 0
    for raw in raws:
        if batch and size + len(raw) > _DATAGRAM_LIMIT:
            yield b"".join(batch), len(batch)
            batch, size = [], 0
        batch.append(raw)
        size += len(raw)
    yield b"".join(batch), len(batch)
