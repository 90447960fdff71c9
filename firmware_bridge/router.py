"""One autopilot, many readers: ground stations, SDKs and companions on UDP and TCP, as behind PX4 or mavlink-router.

Who hears what:
- what the autopilot says, except the HIL messages, goes to every client; what it addresses to a system goes to the
  clients at which that system was heard
- what a client says goes to the autopilot and to the other clients; what it addresses to a system goes only to where
  that system was heard, and to the autopilot if it was heard nowhere
- never back to whom it came from: what claims to be from the autopilot's own system, or is byte for byte what another
  client was just shown, is a loop and ends here

Frames go on exactly as they came, signed or not (`router_signing` says when not). Nothing here waits: a client that
floods, stalls or talks nonsense costs a bounded amount of time and is counted.

A client runs on wall-clock time, so its first frame makes a run no longer repeatable: `received_any`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, target
from firmware_bridge.codecs.signing import SETUP_SIGNING, Check
from firmware_bridge.router_endpoint import PX4_ENDPOINTS, Address, Endpoint
from firmware_bridge.router_hold import Hold
from firmware_bridge.router_ports import Client, Port, TcpPort, UdpPort, Watch
from firmware_bridge.router_signing import AutopilotSide, ClientSide, copy_for_autopilot, for_autopilot

__all__ = ["HIL_FAMILY", "PX4_ENDPOINTS", "Endpoint", "Router", "RouterStats"]

_HEARTBEAT = MSGID["HEARTBEAT"]
# The bench's own conversation with the autopilot: neither shown to clients nor taken from them.
HIL_FAMILY = frozenset(msgid for name, msgid in MSGID.items() if name.startswith("HIL_"))

_BYTES_PER_TICK = 2048  # to the autopilot: at 921600 baud a 4 ms tick has room for 368 bytes, at USB speed for more
_OVERHEARD_LIMIT = 4096
_ECHO_NS = 500_000_000  # of wall clock: how long an echo through another router may take
_ECHOES_REMEMBERED = 512
_ECHO_REPEATS = 50  # the same frame from the same client so often within that time: it goes round in a circle
_EVENTS_LIMIT = 500  # per run
_REFUSALS = {
    Check.UNSIGNED: "its messages are not signed, and this router wants them signed; they are dropped",
    Check.FORGED: "its messages are signed with another key, or altered; they are dropped",
    Check.REPLAYED: "its messages are old ones, or its clock is more than a minute behind; they are dropped",
}


@dataclass
class RouterStats:
    """Frames since `open`, unless they say otherwise."""

    to_clients: int = 0
    from_clients: int = 0  # admitted
    between_clients: int = 0
    rejected: int = 0  # HIL messages from clients
    looped: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    unroutable: int = 0  # from the autopilot, to a system that no client is
    damaged_bytes: int = 0  # bytes from clients that were no frame of the dialect
    dropped: int = 0  # frames for which there was no room, to or from clients
    turned_away: int = 0  # datagrams and connections for which there was no place
    repeated_heartbeats: int = 0
    repeated_setpoints: int = 0
    clients: int = 0


@dataclass
class _Shown:
    """A client's frame that others were shown: should it come back, it is an echo."""

    origin: Client
    wall_ns: int
    repeats: int = 0


class Router:
    """Endpoints for clients. Per tick: `forward` what the autopilot said, and `collect` what clients said.

    Until a client has spoken, only heartbeats go out to an endpoint: enough to be found by, and nearly free.
    """

    def __init__(
        self,
        endpoints: Sequence[Endpoint] = PX4_ENDPOINTS,
        *,
        hold: bool = False,
        clients_sign: ClientSide | None = None,
        autopilot_signs: AutopilotSide | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`hold`: repeat clients' heartbeats and set-points in simulated time (`router_hold`)."""
        self._endpoints = tuple(endpoints)
        self._holding = hold
        self._clients_sign, self._autopilot_signs = clients_sign, autopilot_signs
        self._clock_ns = clock_ns
        self._ports: list[Port] = []
        self._reset()

    def _reset(self) -> None:
        self._watch = Watch()
        self._hold = Hold()
        self._stats = RouterStats()
        self._events: list[tuple[str, str]] = []
        self._said = 0
        self._overheard: list[Frame] = []
        self._autopilot_ids: set[tuple[int, int]] = set()  # (system, component) heard on the autopilot's wire
        self._shown: dict[bytes, _Shown] = {}  # what clients said last that others were shown
        self._waiting: list[Client] = []  # have something for the autopilot
        self._turn = 0
        self._t_ns = 0
        self.received_any = False

    def open(self) -> None:
        """Bind every endpoint. PortBusy or PortNotFound name the one that cannot be."""
        self.close()
        self._reset()
        try:
            for endpoint in self._endpoints:
                self._ports.append(self._port(endpoint))
                if endpoint.is_open_to_others and self._clients_sign is None:
                    self._say("warning", f"{_where(endpoint)}: anybody on the network may command the vehicle here")
        except BaseException:
            self.close()
            raise

    def _port(self, endpoint: Endpoint) -> Port:
        if endpoint.tcp:
            return TcpPort(endpoint, self._watch, self._heard, self._gone)
        return UdpPort(endpoint, self._watch, self._heard, self._clock_ns)

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
        """The counters by name, for run.json."""
        return asdict(self.stats)

    @property
    def local_addresses(self) -> list[Address]:
        """Where clients may send to, one address per endpoint."""
        return [port.address for port in self._ports]

    def take_events(self) -> list[tuple[str, str]]:
        """(kind, text) of what happened since the last call: clients that came, stalled, were refused."""
        if not self._events:
            return self._events
        events, self._events = self._events, []
        return events

    def take_overheard(self) -> list[Frame]:
        """What clients said to each other only, since the last call: the autopilot's wire does not show it."""
        if not self._overheard:
            return self._overheard
        frames, self._overheard = self._overheard, []
        return frames

    # -- from the autopilot -------------------------------------------------------------------------------------

    def forward(self, frames: Sequence[Frame]) -> None:
        """Send the autopilot's `frames`, except HIL messages, to the clients. Never waits."""
        shown = [frame for frame in frames if frame[0] not in HIL_FAMILY and frame[0] != SETUP_SIGNING]
        if not shown:
            return
        for frame in shown:
            self._autopilot_ids.add((frame.sysid, frame.compid))
        if self._autopilot_signs is not None:
            self._autopilot_signs.heard(shown)
        spoken = [(port, client) for port in self._ports for client in port.clients() if client.spoken]
        if not spoken:
            # Nobody listens yet: sign and sort heartbeats only.
            shown = [frame for frame in shown if frame[0] == _HEARTBEAT]
            if not shown:
                return
        sign = self._clients_sign.sign if self._clients_sign is not None else None
        addressed = [(target(frame), sign(frame.raw) if sign else frame.raw) for frame in shown]
        for port, client in spoken:
            self._send(port, client, [raw for to, raw in addressed if client.wants(*to)])
        if spoken:
            for (system, component), _ in addressed:
                if system and not any(client.wants(system, component) for _, client in spoken):
                    self._stats.unroutable += 1
        heartbeats = [raw for frame, (_, raw) in zip(shown, addressed, strict=True) if frame[0] == _HEARTBEAT]
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
        """Whole frames from clients for this tick's write, at simulated time `t_ns`. Never waits.

        Each client's come in their order; between clients they take turns.
        """
        self._t_ns = t_ns
        self._watch.serve()
        data = self._take() if self._waiting else b""
        if self._holding:
            data += self._repeated(t_ns)
        return data

    def _heard(self, client: Client, data: bytes) -> None:
        garbage = client.parser.garbage_bytes
        frames = client.parser.feed(data)
        self._stats.damaged_bytes += client.parser.garbage_bytes - garbage
        if frames:
            wall_ns = self._clock_ns()
            for frame in frames:
                if self._admitted(client, frame, wall_ns):
                    self._route(client, frame, wall_ns)

    def _admitted(self, client: Client, frame: Frame, wall_ns: int) -> bool:
        if self._clients_sign is not None:
            found = self._clients_sign.check(frame)
            if found is not Check.GOOD:
                name = found.value
                setattr(self._stats, name, getattr(self._stats, name) + 1)
                self._tell_once(client, name, _REFUSALS[found])
                return False
        if frame.msgid in HIL_FAMILY:
            self._stats.rejected += 1
            return False
        if (frame.sysid, frame.compid) in self._autopilot_ids:
            self._stats.looped += 1
            self._tell_once(client, "loop", "sends the autopilot's own messages back: a loop; they end here")
            return False
        if self._shown and self._is_echo(client, frame.raw, wall_ns):
            self._stats.looped += 1
            self._tell_once(client, "echo", "sends other clients' messages back: a loop; they end here")
            return False
        return True

    def _is_echo(self, client: Client, raw: bytes, wall_ns: int) -> bool:
        """Whether another client was just shown this very frame. Its own sender may repeat it, within reason."""
        shown = self._shown.get(raw)
        if shown is None or wall_ns - shown.wall_ns > _ECHO_NS:
            return False
        shown.repeats += 1
        return shown.origin is not client or shown.repeats > _ECHO_REPEATS

    def _show(self, client: Client, raw: bytes, wall_ns: int, others: Sequence[tuple[Port, Client]]) -> None:
        for port, other in others:
            self._stats.between_clients += 1
            self._send(port, other, [raw])
        shown = self._shown.get(raw)
        if shown is not None and wall_ns - shown.wall_ns <= _ECHO_NS:
            return
        self._shown.pop(raw, None)
        self._shown[raw] = _Shown(client, wall_ns)
        if len(self._shown) > _ECHOES_REMEMBERED:
            del self._shown[next(iter(self._shown))]

    def _route(self, client: Client, frame: Frame, wall_ns: int) -> None:
        if not client.spoken:
            client.spoken = True
            self._stats.clients += 1
            self._say("status", f"{client.name}: first heard, as system {frame.sysid} component {frame.compid}")
        self.received_any = True
        client.heard_ns = wall_ns
        client.learn(frame)
        self._stats.from_clients += 1
        system, component = target(frame)
        secret = frame.msgid == SETUP_SIGNING  # carries a key
        others = [
            (port, other)
            for port in self._ports
            for other in port.clients()
            if other.spoken and other is not client and not secret and other.wants(system, component)
        ]
        if others:
            self._show(client, frame.raw, wall_ns, others)
        if not system or not others or self._is_for_autopilot(system, component):
            self._to_autopilot(client, frame, wall_ns)
        elif len(self._overheard) < _OVERHEARD_LIMIT:
            self._overheard.append(frame)

    def _is_for_autopilot(self, system: int, component: int) -> bool:
        if component:
            return (system, component) in self._autopilot_ids
        return any(heard == system for heard, _ in self._autopilot_ids)

    def _to_autopilot(self, client: Client, frame: Frame, wall_ns: int) -> None:
        if not client.enqueue(for_autopilot(frame.raw, self._clients_sign, self._autopilot_signs)):
            self._stats.dropped += 1
            self._tell_once(client, "flood", "sends more than the autopilot's wire can take; the surplus is dropped")
            return
        if client not in self._waiting:
            self._waiting.append(client)
        if self._holding:
            self._hold.heard(client, frame, self._t_ns, wall_ns)

    def _take(self) -> bytes:
        """Of every client that has something, one frame in turn, as long as there is room."""
        data: list[bytes] = []
        room = _BYTES_PER_TICK
        waiting = self._waiting
        while waiting:
            # Whoever was cut off by the end of the last tick's room begins this one.
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
        return b"".join(copy_for_autopilot(copy.raw, self._clients_sign, self._autopilot_signs) for copy in copies)

    # -- what happened ------------------------------------------------------------------------------------------

    def _gone(self, client: Client, why: str) -> None:
        if client.spoken or why != "left":
            self._say("warning" if why != "left" else "status", f"{client.name}: {why}")

    def _tell_once(self, client: Client, reason: str, text: str) -> None:
        if reason not in client.refused:
            client.refused.add(reason)
            self._say("warning", f"{client.name}: {text}")

    def _say(self, kind: str, text: str) -> None:
        # Whoever connects and leaves all day long must not fill the recording.
        if self._said < _EVENTS_LIMIT:
            self._said += 1
            self._events.append((kind, text))


class RouterSource:
    """The router as a source of commands: hands the autopilot's words on, brings the clients' in.

    What is collected goes to the autopilot and is recorded with everything else that does; what clients say only to
    each other is taken by `on_overheard`.
    """

    def __init__(
        self,
        router: Router,
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        on_overheard: Callable[[int, Sequence[Frame]], None] = lambda _t_ns, _frames: None,
    ) -> None:
        self._router = router
        self._on_event, self._on_overheard = on_event, on_overheard

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        router = self._router
        if frames:
            router.forward(frames)
        data = router.collect(t_ns)
        for kind, text in router.take_events():
            self._on_event(t_ns, kind, text)
        overheard = router.take_overheard()
        if overheard:
            self._on_overheard(t_ns, overheard)
        return data


def _where(endpoint: Endpoint) -> str:
    host, port = endpoint.local
    return f"{endpoint.name} {'tcp' if endpoint.tcp else 'udp'} {host}:{port}"
