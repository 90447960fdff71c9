"""The clients of a session: who has a place, with what credit and which frames under way, and what was counted.

A client's clock against the bench's, from what its answers say about both.

With a frame sent at T1 (bench), received at T2, answered at T3 (client) and the answer here at T4 (bench), RFC 5905
(section 8):

    offset = ((T2 - T1) + (T3 - T4)) / 2        client's clock minus the bench's
    delay  = (T4 - T1) - (T3 - T2)              time on the wires, both ways

The offset is wrong by half the difference of the two ways, so by at most delay / 2. Of the last exchanges the one with
the least delay is taken (RFC 5905, section 10, the clock filter); an older one counts as worse by what clocks may have
drifted since. A frame is much longer than its answer, and over a slow wire that is such a difference; a client that
compares clocks by pings, short in both directions, tells its own reading in addition, and the surer one counts.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import NamedTuple

from firmware_bridge.codecs.companion import MAX_CREDIT, Done, Hello, HelloRefused
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import ClientInfo, Reply
from hil.signals.latency import LatencyHistogram

_CLOCKS_APART_NS = 1_000_000  # how much longer than here a function may seem to have taken by another clock
_UNKNOWN = 256  # senders of nonsense that are remembered


_EXCHANGES = 64
_DRIFT = 100e-6  # quartz: some tens of ppm on each side


class ClockReading(NamedTuple):
    t_ns: int  # bench clock, when it was taken
    offset_ns: int  # client's clock minus the bench's
    delay_ns: int


class ClockOffset:
    """Minimum-delay filter over the last exchanges.

    All readings grow worse at one rate, so which is the surest does not depend on when that is asked: a reading
    is kept until a surer one comes or the window has passed it, and the first of those kept is the one wanted.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, float, ClockReading]] = deque()  # number, what it counts as at time 0, reading
        self._count = 0

    def add(self, t1_ns: int, t2_ns: int, t3_ns: int, t4_ns: int) -> None:
        """One exchange: bench sent, client received, client sent, bench received."""
        delay_ns = (t4_ns - t1_ns) - (t3_ns - t2_ns)
        if delay_ns < 0 or t3_ns < t2_ns:
            return  # a clock jumped, or the client makes times up
        self._add(ClockReading(t4_ns, ((t2_ns - t1_ns) + (t3_ns - t4_ns)) // 2, delay_ns))

    def add_reading(self, t_ns: int, offset_ns: int, delay_ns: int) -> None:
        """What the client found out itself."""
        self._add(ClockReading(t_ns, offset_ns, delay_ns))

    def _add(self, reading: ClockReading) -> None:
        kept = self._kept
        counts_as = reading.delay_ns - 2.0 * _DRIFT * reading.t_ns
        self._count += 1
        while kept and kept[-1][1] > counts_as:
            kept.pop()
        kept.append((self._count, counts_as, reading))
        while kept[0][0] <= self._count - _EXCHANGES:
            kept.popleft()

    @property
    def best(self) -> ClockReading | None:
        """The surest reading; None before the first."""
        return self._kept[0][2] if self._kept else None


class UnderWay(NamedTuple):
    """A frame that a client has not answered yet."""

    t_begun_ns: int  # when the bench set about sending it
    t_sent_ns: int
    slot: int | None  # of the ring


@dataclass
class ClientStats:
    """Of one name, over all its connections."""

    frames: int = 0  # sent
    dropped: int = 0  # not sent: no credit, no room, or not joined yet
    bytes: int = 0  # of headers and arrays sent; of arrays in shared memory too
    malformed: int = 0
    returned: int = 0
    overhead: LatencyHistogram = field(default_factory=LatencyHistogram)  # bench sets about sending to answer, less t2
    clock_offset_ns: int = 0  # client's clock minus the bench's, the last reading


class Client:
    """A client with a place. `ports`: identity and connection on each sensor's port, where sensors have their own."""

    def __init__(
        self, hello: Hello, identity: bytes, fd: int, topics: frozenset[str], groups: frozenset[str], stats: ClientStats
    ) -> None:
        self.hello = hello
        self.name, self.control, self.topics, self.stats = hello.name, hello.control, topics, stats
        self.identity, self.fd = identity, fd
        self.credit = hello.credit
        self.under_way: dict[int, UnderWay] = {}
        self.dropped_since = 0
        self.malformed_in_a_row = 0
        self.clock = ClockOffset()
        self.groups = groups
        self.ports: dict[str, tuple[bytes, int]] = {}
        self.in_ring = False
        self.user = ""  # public key, where there is one

    @property
    def ready(self) -> bool:
        """Whether frames can go: it has said on every sensor's port who it is."""
        return self.groups <= self.ports.keys()

    def add_credit(self, n: int) -> bool:
        """Whether that was within what a client may have."""
        if self.credit + n > MAX_CREDIT:
            return False
        self.credit += n
        return True

    def count_dropped(self, frames: int = 1) -> None:
        """Frames that passed it by."""
        self.stats.dropped += frames
        self.dropped_since += frames

    def answered(self, done: Done, t_ns: int) -> tuple[Reply, list[int | None]]:
        """What it says of a frame, here at `t_ns`, measured and counted; and the slots of the ring that it has read.
        CodecError."""
        if done.frame not in self.under_way:
            raise CodecError(f"done: frame {done.frame} was not sent, or has been answered")
        if done.desired is not None and not self.control:
            raise CodecError("done: a desired state of a client that has no control")
        if done.detections is not None and done.detections.topic not in self.topics:
            raise CodecError(f"done: detections in {done.detections.topic[:60]!a}, a topic that it does not get")
        sent = self.under_way[done.frame]
        if done.t2_ns > t_ns - sent.t_sent_ns + _CLOCKS_APART_NS:
            raise CodecError(f"done: t2_ns {done.t2_ns} is longer than the frame was away, {t_ns - sent.t_sent_ns}")
        # Frames are answered in order: what is older, the client has passed over.
        answered = [self.under_way.pop(n) for n in list(self.under_way) if n <= done.frame]
        self.credit = min(self.credit + 1, MAX_CREDIT)
        self.clock.add(sent.t_sent_ns, done.t_received_ns, done.t_sent_ns, t_ns)
        reading, stats = self.clock.best, self.stats
        offset_ns = 0 if reading is None else reading.offset_ns
        stats.clock_offset_ns = offset_ns
        stats.overhead.add(t_ns - sent.t_begun_ns - done.t2_ns)
        reply = Reply(
            self.name,
            done.frame,
            done.desired,
            done.finished,
            done.t2_ns,
            done.t_received_ns,
            done.t_sent_ns,
            t_ns,
            offset_ns,
            sent.t_sent_ns,
            done.report,
            done.detections,
        )
        return reply, [one.slot for one in answered]

    def info(self) -> ClientInfo:
        return ClientInfo(self.name, self.topics, self.control, self.credit, self.stats.returned)


class Clients:
    """Who is here, who was, and unknown senders of nothing sensible so far."""

    def __init__(self) -> None:
        self.by_name: dict[str, Client] = {}
        self._by_identity: dict[bytes, Client] = {}
        self.stats: dict[str, ClientStats] = {}
        self.lost: dict[str, str] = {}  # why, by name; those that came back are not in it
        self._names: dict[int, tuple[bytes, str]] = {}  # by connection: who has had a place there
        self._unknown: OrderedDict[bytes, int] = OrderedDict()

    def at(self, identity: bytes) -> Client | None:
        return self._by_identity.get(identity)

    def on_connection(self, fd: int) -> Client | None:
        return next((c for c in self.by_name.values() if c.fd == fd), None)

    def stats_of(self, name: str) -> ClientStats:
        return self.stats.setdefault(name, ClientStats())

    def check_name(self, identity: bytes, fd: int, name: str) -> None:
        """HelloRefused for a second name on one connection."""
        before = self._names.get(fd)
        if before is not None and before[0] == identity and before[1] != name:
            raise HelloRefused("name", f"this connection is {before[1]}'s; {name} needs one of its own")

    def connection_ended(self, fd: int) -> None:
        self._names.pop(fd, None)

    def add(self, client: Client) -> None:
        self.by_name[client.name] = client
        self._by_identity[client.identity] = client
        self._names[client.fd] = (client.identity, client.name)
        self._unknown.pop(client.identity, None)
        if self.lost.pop(client.name, None) is not None:
            client.stats.returned += 1

    def remove(self, client: Client, why: str) -> None:
        if self.by_name.get(client.name) is client:
            del self.by_name[client.name]
            self.lost[client.name] = why
        self._by_identity.pop(client.identity, None)

    def strike(self, identity: bytes) -> int:
        """How many messages without sense this unknown sender has sent in a row, with this one. Few are remembered."""
        strikes = self._unknown.pop(identity, 0) + 1
        self._unknown[identity] = strikes
        while len(self._unknown) > _UNKNOWN:
            self._unknown.popitem(last=False)
        return strikes
