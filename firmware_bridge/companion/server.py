"""The bench's end of the companion link: registers clients, sends them frames, takes their answers. One thread.

A client is registered from its welcome until its connection ends, it sends a bye or too many malformed messages, or
`drop` removes it. A client of the same name may then join in its place and gets the frames from then on. A frame costs
a credit, so that no queue grows without bound; a frame that cannot be sent at once is dropped and counted. No call
waits longer than its limit.

Errors of a client or its connection never raise here: they are counted, reported to the client if it is connected, and
reported to `on_event` (joined, left, lost, refused, malformed, wire). Only setting up raises.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import zmq

from firmware_bridge.codecs import companion as wire
from firmware_bridge.codecs.companion_view import View
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.clients import Client, ClientRegistry, ClientStats, UnderWay
from firmware_bridge.companion.frames import ClientInfo, CompanionFrame, Reply, SessionFacts
from firmware_bridge.companion.outgoing import Outgoing
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.shared_ring import SharedRing
from firmware_bridge.companion.sockets import CONTROL, Received, Sockets, Unreachable, group_of
from firmware_bridge.companion.validator import HelloValidator
from signals.errors import HandshakeError, LinkClosed

_SERVE_NS = 500_000  # for processing messages before the caller's limit is checked; one message can take longer
_MS = 1_000_000
_SLEEP_NS = 100_000
_ROUND_MS = 50  # how often the caller's own checks run while no message comes
_LINGER_MS = 300  # for the last messages to leave
_REFUSALS_KEPT = 20
_MALFORMED_IN_A_ROW = 10  # so many remove a client


def _ignore_view(client: str, view: View) -> None:
    """Drop a view: the bench has no display for it."""


class CompanionServer:
    """One session. `on_event(kind, text)` and `on_view(client, view)` are called from within the calls below.

    `unplugged(client)` returns True while a declared fault keeps this client's link unplugged.
    """

    def __init__(
        self,
        settings: CompanionSettings,
        facts: SessionFacts,
        *,
        on_event: Callable[[str, str], None] | None = None,
        on_view: Callable[[str, View], None] = _ignore_view,
        unplugged: Callable[[str], bool] = lambda _client: False,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.settings, self.facts = settings, facts
        self.session = secrets.token_hex(8)
        self.malformed = 0  # messages, of clients and unknown senders
        self.refused: list[str] = []  # the last refusals, with their reasons
        self._on_event: Callable[[str, str], object] = on_event if on_event is not None else _ignore_event
        self._on_view, self._unplugged = on_view, unplugged
        self._clock_ns = clock_ns
        self._clients = ClientRegistry()
        self._validator = HelloValidator(settings, facts, self._clients)
        self._endpoint = ""
        self._sockets: Sockets | None = None
        self._ring: SharedRing | None = None

    # --- beginning and end ---

    def open(self) -> None:
        """Bind. ConfigError (keys), PortBusy, PortNotFound."""
        self._sockets = Sockets(self.settings, sorted(self.facts.topics))
        self._endpoint = self._sockets.by_group[CONTROL].endpoint
        if self.settings.arrangement == "shared_memory":
            try:
                self._ring = SharedRing(self.settings.ring_bytes)
            except BaseException:
                self.close()
                raise

    @property
    def endpoint(self) -> str:
        """The address that clients connect to, with the port that the system chose."""
        return self._endpoint

    def close(self, status: str = "", text: str = "") -> None:
        """Send every client the end of the session and close all sockets, within a second. May be called twice."""
        last = wire.encode_end(status, text)
        for client in list(self._clients.by_name.values()):
            self._send_message(client.identity, last)
            self._clients.remove(client, "the session ended")
        if self._sockets is not None:
            self._sockets.close(_LINGER_MS)
            self._sockets = None
        if self._ring is not None:
            self._ring.close()
            self._ring = None

    # --- clients ---

    def wait_for_clients(
        self, count: int, limit_s: float, while_waiting: Callable[[], None] | None = None
    ) -> tuple[ClientInfo, ...]:
        """Wait until so many clients have joined. HandshakeError with their names and the refusals if they do not."""
        deadline_ns = self._clock_ns() + int(limit_s * 1e9)
        while len(self.ready_names) < count:
            left_ns = deadline_ns - self._clock_ns()
            if left_ns <= 0:
                names = ", ".join(self.ready_names) or "none"
                refused = f"; refused: {'; '.join(self.refused)}" if self.refused else ""
                raise HandshakeError(
                    self.endpoint,
                    f"{len(self.ready_names)} of {count} clients within {limit_s:g} s ({names}){refused}; start the "
                    "others, or raise companion.connect_timeout_s",
                )
            self.poll(min(left_ns * 1e-9, _ROUND_MS * 1e-3))
            if while_waiting is not None:
                while_waiting()
        return self.clients

    @property
    def ready_names(self) -> tuple[str, ...]:
        """Names of the clients that frames can be sent to, in the order in which they joined."""
        return tuple(name for name, client in self._clients.by_name.items() if client.ready)

    @property
    def clients(self) -> tuple[ClientInfo, ...]:
        return tuple(client.info() for client in self._clients.by_name.values() if client.ready)

    @property
    def lost(self) -> dict[str, str]:
        """The lost clients that have not come back: name and reason."""
        return dict(self._clients.lost)

    @property
    def topics(self) -> frozenset[str]:
        """All topics that the registered clients have subscribed to."""
        return frozenset().union(*(client.topics for client in self._clients.by_name.values()))

    def limit_topics(self, topics: frozenset[str]) -> None:
        """Refuse, from now on, clients that ask for other topics than these."""
        self._validator.computed_topics = topics

    def stats(self) -> dict[str, ClientStats]:
        """Return the counts of every client of the session, by name."""
        return dict(self._clients.stats)

    def drop(self, name: str, why: str) -> None:
        """Remove a client, with a message to it; it may join again. Does nothing if it is not registered."""
        client = self._clients.by_name.get(name)
        if client is not None:
            self._send_message(client.identity, wire.encode_end("dropped", why))
            self._lose(client, why)

    # --- frames ---

    def send(self, frame: CompanionFrame, *, to: Sequence[str] | None = None, dropped: int = 0) -> list[str]:
        """Send a frame to these clients, or to all, without waiting. Return the names of those that it was sent to.

        A drop is counted for each of the others. `dropped`: earlier frames that the caller left out for these clients.
        Arrays are copied before it returns. CodecError for arrays that cannot be sent.
        """
        if self._sockets is None:
            raise LinkClosed("companion", "the session is closed")
        t_begun_ns = self._clock_ns()
        out = Outgoing(frame)
        targets: list[Client] = []
        for name in self._clients.by_name if to is None else to:
            client = self._clients.by_name.get(name)
            if client is not None and client.ready and client.credit > 0 and frame.frame not in client.under_way:
                client.count_dropped(dropped)
                targets.append(client)
            elif client is not None:
                client.count_dropped()
        readers = [client for client in targets if client.in_ring]
        slot: int | None = None
        block_topics: frozenset[str] = frozenset().union(*(client.topics for client in readers))
        if readers and self._ring is not None:
            slot = self._ring.put(out.block(block_topics), [client.name for client in readers])
        return [client.name for client in targets if self._send_to(client, out, slot, block_topics, t_begun_ns)]

    def _send_to(
        self, client: Client, out: Outgoing, slot: int | None, block_topics: frozenset[str], t_begun_ns: int
    ) -> bool:
        """Send to one client. Return False, and count a drop, if its buffer or the ring buffer is full.

        `slot` of the ring buffer contains the arrays of `block_topics`.
        """
        t_sent_ns = self._clock_ns()
        sent = False
        try:
            if not client.in_ring:
                sent = self._send_parts(client, out, t_sent_ns)
            elif slot is not None:
                header = out.header(
                    client.topics, block_topics, t_sent_ns=t_sent_ns, dropped=client.dropped_since, release=slot
                )
                client.stats.bytes += len(header) + out.array_bytes(client.topics)
                sent = self._push(client.identity, CONTROL, [header])
        except Unreachable:
            self._release(client, slot)  # the frame is not under way yet
            self._lose(client, "its connection has gone")
            return False
        if not sent:
            self._release(client, slot)
            client.count_dropped()
            return False
        client.credit -= 1
        client.dropped_since = 0
        client.under_way[out.frame.frame] = UnderWay(t_begun_ns, t_sent_ns, slot if client.in_ring else None)
        client.stats.frames += 1
        return True

    def _send_parts(self, client: Client, out: Outgoing, t_sent_ns: int) -> bool:
        """Send over the common socket, or each sensor's topics over the sensor's socket."""
        topics = sorted(client.topics & out.topics)
        parts = [(CONTROL, client.topics)]
        frame_topics: list[str] | None = None
        if client.groups and topics:
            frame_topics = topics
            groups = [(group, frozenset(t for t in topics if group_of(t) == group)) for group in client.groups]
            # Small ones first: the client reads them while the large ones are being sent.
            parts = sorted((p for p in groups if p[1]), key=lambda p: (out.block(p[1]).size, p[0]))
        sent = True
        for group, part_topics in parts:
            header = out.header(
                part_topics, part_topics, t_sent_ns=t_sent_ns, dropped=client.dropped_since, ports_of_frame=frame_topics
            )
            client.stats.bytes += len(header) + out.block(part_topics).size
            identity = client.identity if group == CONTROL else client.ports[group][0]
            sent = self._push(identity, group, [header, *out.body(part_topics)]) and sent
        return sent

    def _push(self, identity: bytes, group: str, parts: Sequence[bytes | zmq.Frame]) -> bool:
        """Return False if the send buffer is full. Unreachable if the client has disconnected."""
        return self._sockets is not None and self._sockets.by_group[group].send(identity, parts)

    def _release(self, client: Client, slot: int | None) -> None:
        """Release a slot that the client has read, or will never read."""
        if self._ring is not None and slot is not None:
            self._ring.release(slot, client.name)

    # --- received messages ---

    def poll(self, limit_s: float) -> list[Reply]:
        """Return the received answers, or wait up to the limit for one. Other messages are processed meanwhile."""
        deadline_ns = self._clock_ns() + int(limit_s * 1e9)
        replies: list[Reply] = []
        while self._sockets is not None:
            self._serve(self._sockets, replies)
            left_ns = deadline_ns - self._clock_ns()
            if replies or left_ns <= 0:
                break
            if left_ns < _MS:  # the poller counts whole milliseconds
                time.sleep(min(left_ns, _SLEEP_NS) * 1e-9)
            else:
                self._sockets.wait(min(left_ns // _MS, _ROUND_MS))
        return replies

    def _serve(self, sockets: Sockets, replies: list[Reply]) -> None:
        """Process one message of each socket in turn, for a short time, so that no flood blocks the bench.

        Each call begins with another socket.
        """
        self._remove_ended(sockets)
        end_ns = self._clock_ns() + _SERVE_NS
        waiting = sockets.in_turn()
        while waiting:
            not_empty = []
            for group, bound in waiting:
                message = bound.receive()
                if message is not None:
                    not_empty.append((group, bound))
                    self._take(group, message, replies)
                    if self._clock_ns() >= end_ns:
                        return  # the caller checks its limit and calls again
            waiting = not_empty
        self._remove_ended(sockets)  # all messages of ended connections have been taken now

    def _remove_ended(self, sockets: Sockets, *, at_once: bool = False) -> None:
        """Remove clients whose connection has ended. `at_once`: even if some of their messages may be unread."""
        for group, bound in sockets.by_group.items():
            ended = bound.ended(self.settings.max_clients, at_once=at_once)
            for text in bound.texts():
                self._refuse_text(f"{bound.endpoint}: {text}", kind="wire")
            for fd in ended:
                if group == CONTROL:
                    self._clients.connection_ended(fd)
                    client = self._clients.on_connection(fd)
                    if client is not None:
                        self._lose(client, "its connection ended")
                    continue
                for client in self._clients.by_name.values():
                    if client.ports.get(group, (b"", -1))[1] == fd:
                        del client.ports[group]
                        self._on_event("wire", f"{client.name}: its connection to the port of {group} ended")

    def _take(self, group: str, message: Received, replies: list[Reply]) -> None:
        t_ns = self._clock_ns()
        client = self._clients.at(message.identity) if group == CONTROL else None
        try:
            if message.parts != 1:
                raise CodecError(f"{message.parts} parts; a client's message has one part, a header")
            decoded = wire.decode_client(message.raw)
            if isinstance(decoded, wire.Hello):
                self._welcome(group, message, decoded)
            elif client is None:
                raise CodecError("the first message must be a hello")
            else:
                self._handle(client, decoded, t_ns, replies)
                client.malformed_in_a_row = 0
        except wire.HelloRefused as error:
            self._refuse(group, message, error)
        except CodecError as error:
            self._malformed(group, message.identity, client, str(error))

    def _handle(
        self,
        client: Client,
        message: wire.Credit | wire.Done | View | wire.Ping | wire.Bye,
        t_ns: int,
        replies: list[Reply],
    ) -> None:
        if isinstance(message, wire.Done):
            reply, slots = client.answered(message, t_ns)
            replies.append(reply)
            for slot in slots:
                self._release(client, slot)
        elif isinstance(message, View):
            self._on_view(client.name, message)
        elif isinstance(message, wire.Ping):
            if message.bench_minus_client_ns is not None and message.round_trip_ns is not None:
                client.clock.add_reading(t_ns, -message.bench_minus_client_ns, message.round_trip_ns)
            self._send_message(client.identity, wire.encode_pong(message, t_ns, self._clock_ns()))
        elif isinstance(message, wire.Credit):
            if not client.add_credit(message.n):
                raise CodecError(f"credit: {client.credit} + {message.n} are more than {wire.MAX_CREDIT}")
        else:
            self._lose(client, f"it left: {message.reason}" if message.reason else "it left", kind="left")

    # --- joining and leaving ---

    def _welcome(self, group: str, message: Received, hello: wire.Hello) -> None:
        user = message.property("User-Id")
        if group != CONTROL:
            client = self._validator.check_port(hello, group, user, self.session)
            client.ports[group] = (message.identity, message.fd)
            if client.ready:
                self._joined(client)
            return
        joined = self._clients.at(message.identity)
        if joined is not None:
            # A client that lost its connection while joining cannot know whether its first hello arrived, and sends
            # it again.
            if hello == joined.hello:
                return
            raise CodecError("hello: this client has joined already; send a bye first")
        if self._sockets is not None:
            self._remove_ended(self._sockets, at_once=True)  # its own earlier connection may just have ended
        self._clients.check_name(message.identity, message.fd, hello.name)
        if self._unplugged(hello.name):
            raise wire.HelloRefused("full", f"the link of {hello.name} is unplugged")
        topics = self._validator.check(hello, message.identity)
        groups = frozenset(map(group_of, topics)) if self.settings.arrangement == "ports" else frozenset()
        client = Client(hello, message.identity, message.fd, topics, groups, self._clients.stats_of(hello.name))
        client.in_ring = self._ring is not None and hello.shared_memory
        client.user = user
        self._clients.add(client)
        self._send_message(client.identity, wire.encode_welcome(self._welcome_of(client)))
        if client.ready:
            self._joined(client)

    def _welcome_of(self, client: Client) -> wire.Welcome:
        """Return the facts of the run, its topics, and the connections that frames will come on."""
        assert self._sockets is not None
        facts, ring = self.facts, self._ring if client.in_ring else None
        topics = sorted(client.topics)
        sensors = {group_of(topic) for topic in topics}
        return wire.Welcome(
            schema=self._validator.schema,
            session=self.session,
            mode=facts.mode,
            tick_ns=facts.tick_ns,
            rate_hz=facts.rate_hz,
            topics={name: facts.topics[name] for name in topics},
            sensors={name: values for name, values in facts.sensors.items() if name in sensors},
            waypoints_W=facts.waypoints_W,
            ports={t: self._sockets.by_group[group_of(t)].endpoint for t in topics} if client.groups else {},
            ring=None if ring is None else wire.Ring(ring.name, ring.size),
            control=client.control,
            views_every_ns=facts.views_every_ns,
        )

    def _joined(self, client: Client) -> None:
        again = "again, " if client.stats.returned else ""
        control = ", in control" if client.control else ""
        self._on_event("joined", f"{client.name} ({again}{len(client.topics)} topics{control})")

    def _refuse(self, group: str, message: Received, error: wire.HelloRefused) -> None:
        self._send_message(message.identity, wire.encode_refused(error.code, str(error)), group)
        if error.code == "malformed":
            self.malformed += 1
        self._refuse_text(f"{error.code}: {error}")

    def _refuse_text(self, text: str, kind: str = "refused") -> None:
        if text not in self.refused:
            self.refused = [*self.refused, text][-_REFUSALS_KEPT:]
            self._on_event(kind, text)

    def _malformed(self, group: str, identity: bytes, client: Client | None, why: str) -> None:
        """Report the fault to the sender, which is removed after too many in a row."""
        self.malformed += 1
        in_a_row = self._clients.count_malformed(identity) if client is None else client.malformed_in_a_row + 1
        if in_a_row <= _MALFORMED_IN_A_ROW:
            self._send_message(identity, wire.encode_refused("malformed", why), group)
            self._on_event("malformed", f"{client.name if client else 'an unknown sender'}: {why}")
        if client is not None:
            client.malformed_in_a_row = in_a_row
            client.stats.malformed += 1
            if in_a_row >= _MALFORMED_IN_A_ROW:
                self._lose(client, f"{in_a_row} malformed messages in a row; the last: {why}")

    def _lose(self, client: Client, why: str, kind: str = "lost") -> None:
        for under_way in client.under_way.values():
            self._release(client, under_way.slot)
        client.under_way.clear()
        self._clients.remove(client, why)
        self._on_event(kind, f"{client.name}: {why}")

    def _send_message(self, identity: bytes, message: bytes, group: str = CONTROL) -> None:
        """Send one message to a client if it is connected and its buffer is not full."""
        with suppress(Unreachable):
            self._push(identity, group, [message])


def _ignore_event(kind: str, text: str) -> None:
    """Drop an event: the caller gave no `on_event`."""
