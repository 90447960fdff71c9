"""The bench's end of the companion link: lets clients in, sends them frames, takes their answers. One thread.

A client has a place from its welcome until its connection ends, it says bye, sends nonsense, or `drop` ends it; a
client of the same name takes the place over and goes on where frames are now. Frames go only against credits, so
nothing queues without bound; what cannot be sent at once is dropped and counted. No call waits longer than it is told.

What is wrong on a wire never raises here: it is counted, told to the client where there is one, and to `on_event`
(joined, left, lost, refused, malformed, wire). Only setting up raises.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import zmq

from firmware_bridge.codecs import companion as wire
from firmware_bridge.codecs.companion_view import View
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.admission import Admission
from firmware_bridge.companion.answering import take_answer
from firmware_bridge.companion.bench_socket import Received
from firmware_bridge.companion.clients import Client, Clients, ClientStats
from firmware_bridge.companion.frames import ClientInfo, CompanionFrame, Reply, SessionFacts
from firmware_bridge.companion.groups import CONTROL, group_of
from firmware_bridge.companion.newcomers import Way
from firmware_bridge.companion.outgoing import Outgoing, Packing
from firmware_bridge.companion.patience import Patience
from firmware_bridge.companion.sender import Sender
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.unreachable import Unreachable
from firmware_bridge.companion.welcoming import welcome_of
from firmware_bridge.companion.wires import Wires, flush_all
from hil.signals.errors import HandshakeError, LinkClosed
from hil.signals.time import NS_PER_MS

_SERVE_NS = 500_000  # then the caller's limit is looked at; only one message can take longer
_LOOK_MS = 5
_NAP_NS = 100_000
_ROUND_MS = 50  # the watch over connections goes on while nothing is heard
_LINGER_MS = 300  # for the last words to leave
_REFUSALS_KEPT = 20


def _unseen(client: str, view: View) -> None:
    """Nobody looks."""


class CompanionServer:
    """One session. `on_event(kind, text)` and `on_view(client, view)` are called from within the calls below.

    `barred`: whose link is unplugged just now."""

    def __init__(
        self,
        settings: CompanionSettings,
        facts: SessionFacts,
        *,
        on_event: Callable[[str, str], None] | None = None,
        on_view: Callable[[str, View], None] = _unseen,
        barred: Callable[[str], bool] = lambda _client: False,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.settings, self.facts = settings, facts
        self.session = secrets.token_hex(8)
        self.malformed = 0  # messages, of clients and strangers
        self.refused: list[str] = []  # who was turned away and why, the last ones
        self._on_event: Callable[[str, str], object] = on_event if on_event is not None else _unheard
        self._on_view, self._barred = on_view, barred
        self._clock_ns = clock_ns
        self._clients = Clients()
        self._admission = Admission(settings, facts, self._clients)
        self._wires = Wires(settings)
        self._packing = Packing()
        self._patience = Patience()
        self._served_ns = 0  # when all of ZeroMQ's sockets were looked at
        self._look_ns = 0  # when ZeroMQ's sockets are looked at again, where all clients have other ways
        self._sender = Sender(self._wires.sockets, None, clock_ns)
        self._turn = 0  # which socket is served first

    # --- beginning and end ---

    def open(self) -> None:
        """Bind. ConfigError (keys), PortBusy, PortNotFound."""
        self._wires.open(self.facts.topics)
        self._sender = Sender(self._wires.sockets, self._wires.ring, self._clock_ns)

    @property
    def endpoint(self) -> str:
        """Where clients connect to, with the port that was given."""
        return self._wires.endpoint

    def close(self, status: str = "", text: str = "") -> None:
        """Tell every client that it is over, and let go of everything. Within a second; may be called twice."""
        last = wire.encode_end(status, text)
        clients = list(self._clients.by_name.values())
        for client in clients:
            self._tell(client.identity, last)
        flush_all([way for client in clients for way in client.ways.values()], _LINGER_MS)
        for client in clients:
            self._remove(client, "the session ended")
        self._wires.close(_LINGER_MS)

    # --- clients ---

    def wait_for_clients(
        self, count: int, limit_s: float, while_waiting: Callable[[], None] | None = None
    ) -> tuple[ClientInfo, ...]:
        """Until so many clients have their place. HandshakeError saying how many came, and who was turned away."""
        deadline_ns = self._clock_ns() + int(limit_s * 1e9)
        while len(self.living) < count:
            left_ns = deadline_ns - self._clock_ns()
            if left_ns <= 0:
                here = ", ".join(self.living) or "none"
                turned = f"; turned away: {'; '.join(self.refused)}" if self.refused else ""
                raise HandshakeError(
                    self.endpoint, f"{len(self.living)} of {count} clients within {limit_s:g} s ({here}){turned}"
                )
            self.poll(min(left_ns * 1e-9, _ROUND_MS * 1e-3))
            if while_waiting is not None:
                while_waiting()
        return self.clients

    @property
    def living(self) -> tuple[str, ...]:
        """Names of the clients that frames can go to, in the order in which they came."""
        return tuple(name for name, client in self._clients.by_name.items() if client.ready)

    @property
    def clients(self) -> tuple[ClientInfo, ...]:
        return tuple(client.info() for client in self._clients.by_name.values() if client.ready)

    @property
    def lost(self) -> dict[str, str]:
        """Why, by name, of clients that are gone and have not come back."""
        return dict(self._clients.lost)

    @property
    def topics(self) -> frozenset[str]:
        """What the clients that are here want."""
        return frozenset().union(*(client.topics for client in self._clients.by_name.values()))

    def limit_topics(self, topics: frozenset[str]) -> None:
        """No more than these from now on: who comes and wants another is refused."""
        self._admission.limit = topics

    def stats(self) -> dict[str, ClientStats]:
        """What was counted, by name, of all that were ever here."""
        return dict(self._clients.stats)

    def drop(self, name: str, why: str) -> None:
        """End a client's place; it is told, and may come back. Nothing if it is not here."""
        client = self._clients.by_name.get(name)
        if client is not None:
            self._tell(client.identity, wire.encode_end("dropped", why))
            self._lose(client, why)

    # --- frames ---

    def send(self, frame: CompanionFrame, *, to: Sequence[str] | None = None, dropped: int = 0) -> list[str]:
        """Send to these clients, or to all; returns who got it. The others' loss is counted, and the `dropped` frames
        that the caller passed them by. Never waits.

        Arrays are copied before it returns. CodecError for arrays that cannot be sent.
        """
        if not self._wires.sockets:
            raise LinkClosed("companion", "the session is closed")
        t_begun_ns = self._clock_ns()
        out = Outgoing(frame, self._packing)
        targets: list[Client] = []
        for name in self._clients.by_name if to is None else to:
            client = self._clients.by_name.get(name)
            if client is not None and client.ready and client.credit > 0 and frame.frame not in client.under_way:
                client.count_dropped(dropped)
                targets.append(client)
            elif client is not None:
                client.count_dropped()
        slot = self._sender.fill_ring(out, [c for c in targets if c.in_ring])
        return [client.name for client in targets if self._send_to(client, out, slot, t_begun_ns)]

    def _send_to(self, client: Client, out: Outgoing, slot: int | None, t_begun_ns: int) -> bool:
        try:
            return self._sender.send(client, out, slot, t_begun_ns)
        except Unreachable:
            self._sender.give_back(client, slot)  # it was not under way yet
            self._lose(client, "its connection has gone")
            return False

    # --- what comes in ---

    def poll(self, limit_s: float) -> list[Reply]:
        """Answers that are here, or come within the limit; returns with the first ones. Serves all else meanwhile."""
        begun_ns = self._clock_ns()
        deadline_ns = begun_ns + int(limit_s * 1e9)
        replies: list[Reply] = []
        while self._wires.sockets:
            beside_zmq = self._hear_ways(replies)
            now_ns = self._clock_ns()
            if not beside_zmq or (now_ns >= self._look_ns and self._has_to_look(now_ns)):
                self._serve(replies)
                now_ns = self._clock_ns()
            if replies or now_ns >= deadline_ns:
                break
            if beside_zmq and self._patience.stays_awake(now_ns - begun_ns):
                continue
            left_ns = deadline_ns - now_ns
            if left_ns < NS_PER_MS:  # the poller counts whole milliseconds
                time.sleep(min(left_ns, _NAP_NS) * 1e-9)
            else:
                self._wait(min(left_ns // NS_PER_MS, _ROUND_MS))
        if limit_s > 0.0:
            self._patience.waited(self._clock_ns() - begun_ns)
        return replies

    def _has_to_look(self, now_ns: int) -> bool:
        """Of who waits for answers on other ways: ZeroMQ takes as long as a frame to ask, its descriptors do not."""
        if now_ns >= self._served_ns + _ROUND_MS * NS_PER_MS or self._wires.stirred():
            return True
        self._look_ns = now_ns + _LOOK_MS * NS_PER_MS
        return False

    def _wait(self, limit_ms: int) -> None:
        """Until something comes."""
        if not self._wires.entrances:
            self._wires.wait(limit_ms, ())
            return
        unsent = [w for c in self._clients.by_name.values() for w in c.ways.values() if w.unsent_bytes]
        # ZeroMQ's descriptors tell of changes only, and may have told before: hence the short limit.
        if self._wires.wait(min(limit_ms, _LOOK_MS), unsent):
            self._served_ns = self._look_ns = 0

    def _serve(self, replies: list[Reply]) -> None:
        """One message of each socket in turn, another socket first each time, and no longer than a moment: so no flood
        holds the bench."""
        self._watch(replies)
        begun_ns = self._clock_ns()
        end_ns = begun_ns + _SERVE_NS
        waiting = list(self._wires.sockets.items())
        self._turn = (self._turn + 1) % len(waiting)
        waiting = waiting[self._turn :] + waiting[: self._turn]
        while waiting:
            still = []
            for group, bound in waiting:
                message = bound.receive()
                if message is not None:
                    still.append((group, bound))
                    self._take(group, message, replies)
                    if self._clock_ns() >= end_ns:
                        return  # and look again at once
            waiting = still
        self._served_ns, self._look_ns = begun_ns, begun_ns + _LOOK_MS * NS_PER_MS

    def _hear_ways(self, replies: list[Reply]) -> bool:
        """One message of each client in turn, until there is an answer, or for a moment. Whether there are clients, and
        all are heard beside ZeroMQ."""
        end_ns = self._clock_ns() + _SERVE_NS
        clients = list(self._clients.by_name.values())
        talking = [(client, client.way) for client in clients if client.way is not None]
        beside_zmq = 0 < len(clients) == len(talking)
        while talking and not replies:
            talking = [(client, way) for client, way in talking if self._hear_on(client, way, replies)]
            if talking and self._clock_ns() >= end_ns:
                break
        return beside_zmq

    def _hear_on(self, client: Client, way: Way, replies: list[Reply]) -> bool:
        """Whether there was a message, and may be another."""
        if way not in client.ways.values():
            return False  # it was lost meanwhile
        try:
            for other in client.ways.values():
                if other.unsent_bytes:
                    other.flush()
            message = way.receive()
        except Unreachable as error:
            self._lose(client, str(error) or "its connection ended")
            return False
        if message is not None:
            self._take_from(client, message, replies)
        return message is not None

    def _let_in(self, group: str, word: bytes, way: Way) -> bool:
        """Whether it is the word of a client that has no such way yet: then this is its."""
        without = (c for c in self._clients.by_name.values() if group in c.ways_needed - c.ways.keys())
        client = next((c for c in without if secrets.compare_digest(c.word.encode("ascii"), word)), None)
        if client is None:
            return False
        client.ways[group] = way
        self._wires.add(way)
        if client.ready:
            self._joined(client)
        return True

    def _watch(self, replies: list[Reply]) -> None:
        """Who has come to the door, and who has gone."""
        for group, entrance in self._wires.entrances.items():
            entrance.serve(partial(self._let_in, group))
        # By a sensor's way nothing is said, but it may have ended.
        sensors = [(c, w) for c in self._clients.by_name.values() for g, w in c.ways.items() if g != CONTROL]
        for one, way in sensors:
            self._hear_on(one, way, replies)
        for group, bound in self._wires.sockets.items():
            ended, texts = bound.gone()
            for text in texts:
                self._refuse_text(f"{bound.endpoint}: {text}", kind="wire")
            for fd in ended:
                if group == CONTROL:
                    self._clients.connection_ended(fd)
                    client = self._clients.on_connection(fd)
                    for _ in range(wire.MAX_CREDIT):  # what it said before it went
                        if client is None or client.way is None or not self._hear_on(client, client.way, replies):
                            break
                    if client is not None and self._clients.at(client.identity) is client:
                        self._lose(client, "its connection ended")
                    continue
                for client in self._clients.by_name.values():
                    if client.ports.get(group, (b"", -1))[1] == fd:
                        del client.ports[group]
                        self._on_event("wire", f"{client.name}: its connection to the port of {group} ended")

    def _take_from(self, client: Client, message: memoryview, replies: list[Reply]) -> None:
        t_ns = self._clock_ns()
        try:
            decoded = wire.decode_client(message)
            if isinstance(decoded, wire.Hello):
                raise CodecError("hello: it has a place already; say bye first")
            self._hear(client, decoded, t_ns, replies)
            client.malformed_in_a_row = 0
        except CodecError as error:
            self._malformed(CONTROL, client.identity, client.fd, client, str(error))

    def _take(self, group: str, message: Received, replies: list[Reply]) -> None:
        t_ns = self._clock_ns()
        client = self._clients.at(message.identity) if group == CONTROL else None
        try:
            if message.parts != 1:
                raise CodecError(f"{message.parts} parts; a client sends headers only, one part each")
            decoded = wire.decode_client(message.raw)
            if isinstance(decoded, wire.Hello):
                self._welcome(group, message, decoded, replies)
            elif client is None:
                raise CodecError("the first message must be a hello")
            else:
                self._hear(client, decoded, t_ns, replies)
                client.malformed_in_a_row = 0
        except wire.HelloRefused as error:
            self._refuse(group, message, error)
        except CodecError as error:
            self._malformed(group, message.identity, message.fd, client, str(error))

    def _hear(
        self,
        client: Client,
        message: wire.Credit | wire.Done | View | wire.Ping | wire.Bye,
        t_ns: int,
        replies: list[Reply],
    ) -> None:
        if isinstance(message, wire.Done):
            replies.append(take_answer(client, message, t_ns, self._sender))
        elif isinstance(message, View):
            self._on_view(client.name, message)
        elif isinstance(message, wire.Ping):
            if message.bench_minus_client_ns is not None and message.round_trip_ns is not None:
                client.clock.add_reading(t_ns, -message.bench_minus_client_ns, message.round_trip_ns)
            self._tell(client.identity, wire.encode_pong(message, t_ns, self._clock_ns()))
        elif isinstance(message, wire.Credit):
            if not client.add_credit(message.n):
                raise CodecError(f"credit: {client.credit} + {message.n} are more than {wire.MAX_CREDIT}")
        else:
            self._lose(client, f"it left: {message.reason}" if message.reason else "it left", kind="left")

    # --- in and out ---

    def _welcome(self, group: str, message: Received, hello: wire.Hello, replies: list[Reply]) -> None:
        user = _user(message)
        if group != CONTROL:
            client = self._admission.check_port(hello, group, user, self.session)
            client.ports[group] = (message.identity, message.fd)
            if client.ready:
                self._joined(client)
            return
        here = self._clients.at(message.identity)
        if here is not None:
            # A client that was cut off while it joined cannot know whether its first hello went with the old
            # connection, and sends it once more.
            if hello == here.hello:
                return
            raise CodecError("hello: it has a place already; say bye first")
        self._watch(replies)  # a predecessor that has just gone makes its place free
        self._clients.check_name(message.identity, message.fd, hello.name)
        if self._barred(hello.name):
            raise wire.HelloRefused("full", f"the link of {hello.name} is unplugged")
        topics = self._admission.check(hello, message.identity)
        groups = frozenset(map(group_of, topics)) if self.settings.arrangement == "ports" else frozenset()
        client = Client(hello, message.identity, message.fd, topics, groups, self._clients.stats_of(hello.name))
        client.credit = min(client.credit, self.settings.max_credit)
        client.in_ring = self._wires.ring is not None and hello.shared_memory
        client.ways_needed = self._wires.ways_of(hello, groups)
        client.word = secrets.token_hex(16)
        client.user, client.address = user, _property(message, "Peer-Address")
        self._clients.add(client)
        told = welcome_of(client, self.facts, self._wires, session=self.session, schema=self._admission.schema)
        self._tell(client.identity, wire.encode_welcome(told))
        if client.ready:
            self._joined(client)

    def _joined(self, client: Client) -> None:
        again = "again, " if client.stats.returned else ""
        control = ", in control" if client.control else ""
        self._on_event("joined", f"{client.name} ({again}{len(client.topics)} topics{control})")

    def _refuse(self, group: str, message: Received, error: wire.HelloRefused) -> None:
        self._tell(message.identity, wire.encode_refused(error.code, str(error)), group)
        if error.code == "malformed":
            self.malformed += 1
        self._refuse_text(f"{error.code}: {error}")
        if self._clients.strike(message.identity) > self.settings.malformed_in_a_row:
            self._wires.sockets[group].cut(message.fd)

    def _refuse_text(self, text: str, kind: str = "refused") -> None:
        if text not in self.refused:
            self.refused = [*self.refused, text][-_REFUSALS_KEPT:]
            self._on_event(kind, text)

    def _malformed(self, group: str, identity: bytes, fd: int, client: Client | None, why: str) -> None:
        self.malformed += 1
        in_a_row = self._clients.strike(identity) if client is None else client.malformed_in_a_row + 1
        limit = self.settings.malformed_in_a_row
        if in_a_row <= limit:
            self._tell(identity, wire.encode_refused("malformed", why), group)
            self._on_event("malformed", f"{client.name if client else 'a stranger'}: {why}")
        if client is not None:
            client.malformed_in_a_row = in_a_row
            client.stats.malformed += 1
            if in_a_row >= limit:
                self._lose(client, f"{in_a_row} messages without sense in a row; the last: {why}")
        if in_a_row >= limit:
            self._wires.sockets[group].cut(fd)

    def _lose(self, client: Client, why: str, kind: str = "lost") -> None:
        for under_way in client.under_way.values():
            self._sender.give_back(client, under_way.slot)
        client.under_way.clear()
        self._remove(client, why)
        self._on_event(kind, f"{client.name}: {why}")

    def _remove(self, client: Client, why: str) -> None:
        self._clients.remove(client, why)
        for way in client.ways.values():
            self._wires.remove(way)
        client.ways.clear()

    def _tell(self, identity: bytes, message: bytes, group: str = CONTROL) -> None:
        """A word to a client, if it can take one."""
        client = self._clients.at(identity) if group == CONTROL else None
        with suppress(Unreachable):
            if client is not None and client.way is not None:
                client.way.send(message)
            elif group in self._wires.sockets:
                self._wires.sockets[group].send(identity, [message])


def _unheard(kind: str, text: str) -> None:
    """Nobody wants to know."""


def _user(message: Received) -> str:
    return _property(message, "User-Id")


def _property(message: Received, name: str) -> str:
    """What the handshake told; "" where it told nothing."""
    try:
        return str(message.frame.get(name))
    except (zmq.ZMQError, KeyError, ValueError):
        return ""
