"""Routes MAVLink between one autopilot and many clients: ground stations, SDKs and companions on UDP and TCP.

As PX4 and mavlink-router do:
- frames of the autopilot, except the HIL messages, go to every client; a frame addressed to a system goes to the
  clients that have sent frames of that system
- frames of a client go to the autopilot and to the other clients; a frame addressed to a system goes only where that
  system has sent frames, and to the autopilot if it has sent none anywhere
- no frame goes back to its sender: a client's frame that claims to be the autopilot's, or equals one that another
  client was just sent, has returned through a loop and is dropped

Frames are forwarded unchanged, signed or not (exceptions: `signing`). No call waits: a client that floods, stalls or
sends invalid bytes costs a bounded amount of time and is counted.

A client runs on wall-clock time, so its first frame makes a run no longer repeatable: `received_any`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, target
from firmware_bridge.codecs.signing import SETUP_SIGNING, Check
from firmware_bridge.router.endpoint import PX4_ENDPOINTS, Endpoint
from firmware_bridge.router.hold import Hold
from firmware_bridge.router.ports import Client, Port, SocketPoller, TcpPort, UdpPort
from firmware_bridge.router.signing import AutopilotSigning, ClientSigning, copy_for_autopilot, for_autopilot

__all__ = ["HIL_FAMILY", "PX4_ENDPOINTS", "Endpoint", "Router", "RouterStats"]

_HEARTBEAT = MSGID["HEARTBEAT"]
# Only between the bench and the autopilot: neither forwarded to clients nor accepted from them.
HIL_FAMILY = frozenset(msgid for name, msgid in MSGID.items() if name.startswith("HIL_"))

_BYTES_PER_TICK = 2048  # to the autopilot: at 921600 baud a 4 ms tick carries 368 bytes, at USB speed more
_BETWEEN_CLIENTS_LIMIT = 4096
_ECHO_NS = 500_000_000  # of wall clock: how long an echo through another router may take
_ECHOES_REMEMBERED = 512
_ECHO_REPEATS = 50  # the same frame from the same client more often within that time is a loop
_EVENTS_LIMIT = 500  # per run
_WARNINGS_LIMIT = 20  # per reason and run
_REFUSALS = {
    Check.UNSIGNED: "its messages are dropped: they are not signed; give the client the router's signing key",
    Check.FORGED: "its messages are dropped: they are signed with another key, or altered; give it the router's key",
    Check.REPLAYED: "its messages are dropped: they are repeated, or its clock is over a minute behind; set the clock",
}


@dataclass
class RouterStats:
    """Counts of frames since `open`, unless stated otherwise."""

    to_clients: int = 0
    from_clients: int = 0  # accepted
    between_clients: int = 0
    rejected: int = 0  # HIL messages from clients
    looped: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    unroutable: int = 0  # from the autopilot, to a system that no client has
    damaged_bytes: int = 0  # bytes from clients outside of valid frames
    dropped: int = 0  # frames to or from clients, because a buffer was full
    turned_away: int = 0  # refused datagrams and connections
    repeated_heartbeats: int = 0
    repeated_setpoints: int = 0
    clients: int = 0


@dataclass
class _Forwarded:
    """A client's frame that was sent to other clients: if one of them sends it back, it is an echo."""

    origin: Client
    wall_ns: int
    repeats: int = 0


class Router:
    """Endpoints for clients. Per tick: `forward` the autopilot's frames, then `collect` those of the clients.

    Until a client has sent a frame, only heartbeats go out to an endpoint, by which clients find the autopilot.
    """

    def __init__(
        self,
        endpoints: Sequence[Endpoint] = PX4_ENDPOINTS,
        *,
        hold: bool = False,
        client_signing: ClientSigning | None = None,
        autopilot_signing: AutopilotSigning | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`hold`: repeat clients' heartbeats and set-points in simulated time (see `hold.py`)."""
        self._endpoints = tuple(endpoints)
        self._holding = hold
        self._client_signing, self._autopilot_signing = client_signing, autopilot_signing
        self._clock_ns = clock_ns
        self._ports: list[Port] = []
        self._reset()

    def _reset(self) -> None:
        self._poller = SocketPoller()
        self._hold = Hold()
        self._stats = RouterStats()
        self._events: list[tuple[str, str]] = []
        self._event_count = 0
        self._warned: dict[str, set[str]] = {}  # reason -> names of the clients that were warned of
        self._between_clients: list[Frame] = []
        self._autopilot_ids: set[tuple[int, int]] = set()  # (system, component) in the autopilot's frames
        self._forwarded: dict[bytes, _Forwarded] = {}  # the last frames that went from client to client
        self._waiting: list[Client] = []  # clients with queued frames for the autopilot
        self._t_ns = 0
        self.received_any = False

    def open(self) -> None:
        """Bind every endpoint. PortBusy or PortNotFound names the one that cannot be bound."""
        self.close()
        self._reset()
        try:
            for endpoint in self._endpoints:
                self._ports.append(self._port(endpoint))
                if endpoint.is_open_to_others and self._client_signing is None:
                    self._event(
                        "warning",
                        f"{_where(endpoint)}: any machine on the network can command the vehicle here; set "
                        "router.signing_key_file, or listen on 127.0.0.1",
                    )
        except BaseException:
            self.close()
            raise

    def _port(self, endpoint: Endpoint) -> Port:
        if endpoint.tcp:
            return TcpPort(endpoint, self._poller, self._received, self._disconnected)
        return UdpPort(endpoint, self._poller, self._received, self._clock_ns)

    def close(self) -> None:
        for port in self._ports:
            port.close()
        self._ports = []
        self._waiting = []

    @property
    def stats(self) -> RouterStats:
        """Counters; brought up to date by reading this property."""
        stats = self._stats
        if self._ports:
            stats.turned_away = sum(port.turned_away for port in self._ports)
        stats.repeated_heartbeats = self._hold.heartbeats
        stats.repeated_setpoints = self._hold.setpoints
        return stats

    def report(self) -> dict[str, int]:
        """Return the counters by name, for run.json."""
        return asdict(self.stats)

    def take_events(self) -> list[tuple[str, str]]:
        """Return (kind, text) of each event since the last call: clients that joined, stalled or were refused."""
        if not self._events:
            return self._events
        events, self._events = self._events, []
        return events

    def take_between_clients(self) -> list[Frame]:
        """Return the frames since the last call that went between clients only, and not to the autopilot."""
        if not self._between_clients:
            return self._between_clients
        frames, self._between_clients = self._between_clients, []
        return frames

    # -- from the autopilot -------------------------------------------------------------------------------------

    def forward(self, frames: Sequence[Frame]) -> None:
        """Send the autopilot's `frames`, except HIL messages, to the clients. Never waits."""
        frames = [frame for frame in frames if frame[0] not in HIL_FAMILY and frame[0] != SETUP_SIGNING]
        if not frames:
            return
        for frame in frames:
            self._autopilot_ids.add((frame.sysid, frame.compid))
        if self._autopilot_signing is not None:
            self._autopilot_signing.follow_clock(frames)
        active = [(port, client) for port in self._ports for client in port.clients() if client.active]
        if not active:
            # Only heartbeats are sent to clients that have not sent anything yet.
            frames = [frame for frame in frames if frame[0] == _HEARTBEAT]
            if not frames:
                return
        sign = self._client_signing.sign if self._client_signing is not None else None
        addressed = [(target(frame), sign(frame.raw) if sign else frame.raw) for frame in frames]
        for port, client in active:
            self._send(port, client, [raw for to, raw in addressed if client.is_addressed(*to)])
        if active:
            for (system, component), _ in addressed:
                if system and not any(client.is_addressed(system, component) for _, client in active):
                    self._stats.unroutable += 1
        heartbeats = [raw for frame, (_, raw) in zip(frames, addressed, strict=True) if frame[0] == _HEARTBEAT]
        if heartbeats:
            for port in self._ports:
                self._stats.to_clients += port.announce(heartbeats)

    def _send(self, port: Port, client: Client, raws: list[bytes]) -> None:
        if raws:
            lost = port.send(client, raws)
            self._stats.to_clients += len(raws) - lost
            self._stats.dropped += lost

    # -- from the clients ---------------------------------------------------------------------------------------

    def collect(self, t_ns: int = 0) -> bytes:
        """Return whole frames from clients to write in this tick, at simulated time `t_ns`. Never waits.

        The frames of one client keep their order; clients take turns.
        """
        self._t_ns = t_ns
        self._poller.serve()
        data = self._interleaved() if self._waiting else b""
        if self._holding:
            data += self._repeated(t_ns)
        return data

    def _received(self, client: Client, data: bytes) -> None:
        garbage = client.parser.garbage_bytes
        frames = client.parser.feed(data)
        self._stats.damaged_bytes += client.parser.garbage_bytes - garbage
        if frames:
            wall_ns = self._clock_ns()
            for frame in frames:
                if self._accepts(client, frame, wall_ns):
                    self._route(client, frame, wall_ns)

    def _accepts(self, client: Client, frame: Frame, wall_ns: int) -> bool:
        if self._client_signing is not None:
            found = self._client_signing.check(frame)
            if found is not Check.GOOD:
                name = found.value
                setattr(self._stats, name, getattr(self._stats, name) + 1)
                self._warn_once(client, name, _REFUSALS[found])
                return False
        if frame.msgid in HIL_FAMILY:
            self._stats.rejected += 1
            return False
        if (frame.sysid, frame.compid) in self._autopilot_ids:
            self._stats.looped += 1
            self._warn_once(
                client,
                "loop",
                "returns the autopilot's own messages; the router drops them: break the loop",
            )
            return False
        if self._forwarded and self._is_echo(client, frame.raw, wall_ns):
            self._stats.looped += 1
            self._warn_once(
                client,
                "echo",
                "returns other clients' messages; the router drops them: break the loop",
            )
            return False
        return True

    def _is_echo(self, client: Client, raw: bytes, wall_ns: int) -> bool:
        """Return True if another client was just sent this frame. Its own sender may repeat it a few times."""
        sent = self._forwarded.get(raw)
        if sent is None or wall_ns - sent.wall_ns > _ECHO_NS:
            return False
        sent.repeats += 1
        return sent.origin is not client or sent.repeats > _ECHO_REPEATS

    def _forward_to(self, client: Client, raw: bytes, wall_ns: int, others: Sequence[tuple[Port, Client]]) -> None:
        for port, other in others:
            self._stats.between_clients += 1
            self._send(port, other, [raw])
        sent = self._forwarded.get(raw)
        if sent is not None and wall_ns - sent.wall_ns <= _ECHO_NS:
            return
        self._forwarded.pop(raw, None)
        self._forwarded[raw] = _Forwarded(client, wall_ns)
        if len(self._forwarded) > _ECHOES_REMEMBERED:
            del self._forwarded[next(iter(self._forwarded))]

    def _route(self, client: Client, frame: Frame, wall_ns: int) -> None:
        if not client.active:
            client.active = True
            self._stats.clients += 1
            self._event("status", f"{client.name}: joined as system {frame.sysid} component {frame.compid}")
        self.received_any = True
        client.last_frame_ns = wall_ns
        client.learn(frame)
        self._stats.from_clients += 1
        system, component = target(frame)
        secret = frame.msgid == SETUP_SIGNING  # carries a key
        others = [
            (port, other)
            for port in self._ports
            for other in port.clients()
            if other.active and other is not client and not secret and other.is_addressed(system, component)
        ]
        if others:
            self._forward_to(client, frame.raw, wall_ns, others)
        if not system or not others or self._is_for_autopilot(system, component):
            self._to_autopilot(client, frame, wall_ns)
        elif len(self._between_clients) < _BETWEEN_CLIENTS_LIMIT:
            self._between_clients.append(frame)

    def _is_for_autopilot(self, system: int, component: int) -> bool:
        if component:
            return (system, component) in self._autopilot_ids
        return any(known == system for known, _ in self._autopilot_ids)

    def _to_autopilot(self, client: Client, frame: Frame, wall_ns: int) -> None:
        if not client.enqueue(for_autopilot(frame.raw, self._client_signing, self._autopilot_signing)):
            self._stats.dropped += 1
            self._warn_once(
                client,
                "flood",
                "sends more than the autopilot's link carries, the rest is dropped: lower its rates",
            )
            return
        if client not in self._waiting:
            self._waiting.append(client)
        if self._holding:
            self._hold.add(client, frame, self._t_ns, wall_ns)

    def _interleaved(self) -> bytes:
        """Return one frame of each waiting client in turn, up to the limit of a tick."""
        data: list[bytes] = []
        room = _BYTES_PER_TICK
        waiting = self._waiting
        while waiting:
            # A client whose frame did not fit into the last tick comes first in this one.
            client = waiting.pop(0)
            raw = client.take(room)
            if raw is None:
                waiting.insert(0, client)
                break
            data.append(raw)
            room -= len(raw)
            if client.queued_bytes:
                waiting.append(client)
        return b"".join(data)

    def _repeated(self, t_ns: int) -> bytes:
        if not self.received_any:
            return b""
        copies = self._hold.due(t_ns, self._clock_ns())
        return b"".join(copy_for_autopilot(copy.raw, self._client_signing, self._autopilot_signing) for copy in copies)

    # -- events -------------------------------------------------------------------------------------------------

    def _disconnected(self, client: Client, why: str) -> None:
        if client.active or why != "left":
            self._event("warning" if why != "left" else "status", f"{client.name}: {why}")

    def _warn_once(self, client: Client, reason: str, text: str) -> None:
        """Warn once per address and reason. UDP clients that are refused are not remembered otherwise."""
        warned = self._warned.setdefault(reason, set())
        if client.name in warned or len(warned) >= _WARNINGS_LIMIT:
            return
        warned.add(client.name)
        last = "; further addresses are only counted" if len(warned) == _WARNINGS_LIMIT else ""
        self._event("warning", f"{client.name}: {text}{last}")

    def _event(self, kind: str, text: str) -> None:
        # A client that connects and disconnects again and again must not fill the recording.
        if self._event_count < _EVENTS_LIMIT:
            self._event_count += 1
            self._events.append((kind, text))


class RouterSource:
    """The router as a source of commands: forwards the autopilot's frames and collects those of the clients.

    `on_between_clients` gets the frames that do not go to the autopilot and so are not recorded with its traffic.
    """

    def __init__(
        self,
        router: Router,
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        on_between_clients: Callable[[int, Sequence[Frame]], None] = lambda _t_ns, _frames: None,
    ) -> None:
        self._router = router
        self._on_event, self._on_between_clients = on_event, on_between_clients

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        router = self._router
        if frames:
            router.forward(frames)
        data = router.collect(t_ns)
        for kind, text in router.take_events():
            self._on_event(t_ns, kind, text)
        between = router.take_between_clients()
        if between:
            self._on_between_clients(t_ns, between)
        return data


def _where(endpoint: Endpoint) -> str:
    host, port = endpoint.local
    return f"{endpoint.name} {'tcp' if endpoint.tcp else 'udp'} {host}:{port}"
