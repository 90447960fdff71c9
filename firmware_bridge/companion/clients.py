"""The client registry of a session: each client with its credit, its frames under way, its clock and its counts.

The offset of a client's clock comes from its answers. A frame is sent by the bench, received and answered by the
client, and the answer arrives at the bench, each at a time on that machine's clock (RFC 5905, section 8):

    offset = ((received - sent) + (answered - arrived)) / 2        client's clock minus the bench's
    delay  = (arrived - sent) - (answered - received)              time on the wire, both ways

The offset is wrong by half the difference between the two directions, so by at most delay / 2. The exchange with the
least delay among the last ones is used (RFC 5905, section 10, the clock filter); the delay of an older one counts as
larger by the possible drift since. A frame is much longer than its answer, which makes the directions differ on a slow
line. A client that compares clocks by pings, short in both directions, also sends its own reading, and the reading with
the smaller error is used.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import NamedTuple

from firmware_bridge.codecs.companion import MAX_CREDIT, Done, Hello, HelloRefused
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import ClientInfo, Reply
from signals.latency import LatencyHistogram

_CLOCK_TOLERANCE_NS = 1_000_000  # for t2 against the time that the frame was away: two clocks measure these
_MAX_UNKNOWN = 256  # unregistered senders of malformed messages that are remembered
_EXCHANGES = 64  # window of the filter
_DRIFT = 100e-6  # quartz: some tens of ppm on each side


class ClockReading(NamedTuple):
    t_ns: int  # bench clock, when it was taken
    offset_ns: int  # client's clock minus the bench's
    delay_ns: int


class ClockOffset:
    """Minimum-delay filter over the last exchanges.

    All readings age at one rate, so the order of their errors does not change with time: a reading is kept until one
    with a smaller error comes or it leaves the window, and the first of the kept readings is the best.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, float, ClockReading]] = deque()  # number, delay as if taken at time 0, reading
        self._count = 0

    def add(self, sent_ns: int, received_ns: int, answered_ns: int, arrived_ns: int) -> None:
        """Add one exchange: times of the bench's clock (sent, arrived) and of the client's (received, answered)."""
        delay_ns = (arrived_ns - sent_ns) - (answered_ns - received_ns)
        if delay_ns < 0 or answered_ns < received_ns:
            return  # a clock jumped, or the client's times are wrong
        offset_ns = ((received_ns - sent_ns) + (answered_ns - arrived_ns)) // 2
        self._add(ClockReading(arrived_ns, offset_ns, delay_ns))

    def add_reading(self, t_ns: int, offset_ns: int, delay_ns: int) -> None:
        """Add a reading that the client measured itself."""
        self._add(ClockReading(t_ns, offset_ns, delay_ns))

    def _add(self, reading: ClockReading) -> None:
        kept = self._kept
        delay_at_0_ns = reading.delay_ns - 2.0 * _DRIFT * reading.t_ns
        self._count += 1
        while kept and kept[-1][1] > delay_at_0_ns:
            kept.pop()
        kept.append((self._count, delay_at_0_ns, reading))
        while kept[0][0] <= self._count - _EXCHANGES:
            kept.popleft()

    @property
    def best(self) -> ClockReading | None:
        """The reading with the smallest error; None before the first."""
        return self._kept[0][2] if self._kept else None


class UnderWay(NamedTuple):
    """A frame that a client has not answered yet."""

    t_begun_ns: int  # when the bench began to send it
    t_sent_ns: int
    slot: int | None  # in the ring buffer; None if the frame was sent by socket


@dataclass
class ClientStats:
    """Counts of one client name, over all its connections."""

    frames: int = 0  # sent
    dropped: int = 0  # not sent: no credit, a full buffer, or not joined yet
    bytes: int = 0  # of headers and arrays, those in shared memory included
    malformed: int = 0
    returned: int = 0  # how often it reconnected after it was lost
    overhead: LatencyHistogram = field(default_factory=LatencyHistogram)  # send to answer, less the computing time t2
    clock_offset_ns: int = 0  # client's clock minus the bench's: best reading at the last answer


class Client:
    """A registered client.

    With a port for each sensor, `groups` holds the sensors whose topics it receives, and `ports` its ZeroMQ identity
    and connection on the port of each.
    """

    def __init__(
        self, hello: Hello, identity: bytes, fd: int, topics: frozenset[str], groups: frozenset[str], stats: ClientStats
    ) -> None:
        self.hello = hello
        self.name, self.control, self.topics, self.stats = hello.name, hello.control, topics, stats
        self.identity, self.fd = identity, fd
        self.credit = hello.credit
        self.under_way: dict[int, UnderWay] = {}
        self.dropped_since = 0  # frames dropped since the last one sent to it
        self.malformed_in_a_row = 0
        self.clock = ClockOffset()
        self.groups = groups
        self.ports: dict[str, tuple[bytes, int]] = {}
        self.in_ring = False  # True if its arrays go through the ring buffer in shared memory
        self.user = ""  # public key, with CURVE

    @property
    def ready(self) -> bool:
        """True once it has a connection to every sensor's port, so that frames can be sent."""
        return self.groups <= self.ports.keys()

    def add_credit(self, n: int) -> bool:
        """Add credit. Return False if that is more than a client may have."""
        if self.credit + n > MAX_CREDIT:
            return False
        self.credit += n
        return True

    def count_dropped(self, frames: int = 1) -> None:
        """Count frames that it did not get."""
        self.stats.dropped += frames
        self.dropped_since += frames

    def answered(self, done: Done, t_ns: int) -> tuple[Reply, list[int | None]]:
        """Process its answer, received at `t_ns`. Return the reply, and the slots that it has finished reading.

        CodecError if the answer does not fit the frames under way.
        """
        if done.frame not in self.under_way:
            raise CodecError(f"done: frame {done.frame} was not sent, or has been answered")
        if done.desired is not None and not self.control:
            raise CodecError("done: a desired state of a client that has no control")
        if done.detections is not None and done.detections.topic not in self.topics:
            raise CodecError(f"done: detections in {done.detections.topic[:60]!a}, a topic that it does not get")
        sent = self.under_way[done.frame]
        if done.t2_ns > t_ns - sent.t_sent_ns + _CLOCK_TOLERANCE_NS:
            raise CodecError(f"done: t2_ns {done.t2_ns} is longer than the frame was away, {t_ns - sent.t_sent_ns}")
        # Frames are answered in order: the client has skipped the older ones.
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
        return reply, [frame.slot for frame in answered]

    def info(self) -> ClientInfo:
        return ClientInfo(self.name, self.topics, self.control, self.credit, self.stats.returned)


class ClientRegistry:
    """The connected clients, the lost ones, and unregistered senders of malformed messages."""

    def __init__(self) -> None:
        self.by_name: dict[str, Client] = {}
        self._by_identity: dict[bytes, Client] = {}
        self.stats: dict[str, ClientStats] = {}
        self.lost: dict[str, str] = {}  # name: reason; without the clients that came back
        self._names: dict[int, tuple[bytes, str]] = {}  # by connection: identity and client name
        self._unknown: OrderedDict[bytes, int] = OrderedDict()

    def at(self, identity: bytes) -> Client | None:
        return self._by_identity.get(identity)

    def on_connection(self, fd: int) -> Client | None:
        return next((c for c in self.by_name.values() if c.fd == fd), None)

    def stats_of(self, name: str) -> ClientStats:
        return self.stats.setdefault(name, ClientStats())

    def check_name(self, identity: bytes, fd: int, name: str) -> None:
        """Raise HelloRefused for a second name on one connection."""
        before = self._names.get(fd)
        if before is not None and before[0] == identity and before[1] != name:
            raise HelloRefused("name", f"this connection belongs to {before[1]}; {name} needs one of its own")

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

    def count_malformed(self, identity: bytes) -> int:
        """Count a malformed message of an unregistered sender. Return how many it has sent in a row."""
        in_a_row = self._unknown.pop(identity, 0) + 1
        self._unknown[identity] = in_a_row
        while len(self._unknown) > _MAX_UNKNOWN:
            self._unknown.popitem(last=False)
        return in_a_row
