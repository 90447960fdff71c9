"""The clients of a session: who has a place, with what credit and which frames under way, and what was counted."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import NamedTuple

from firmware_bridge.codecs.companion import MAX_CREDIT, Hello, HelloRefused
from firmware_bridge.companion.clock_offset import ClockOffset
from firmware_bridge.companion.frames import ClientInfo
from firmware_bridge.companion.groups import CONTROL
from firmware_bridge.companion.newcomers import Way
from hil.signals.latency import LatencyHistogram

_STRANGERS = 256


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
    answered: int = 0
    skipped: int = 0  # sent, and passed over by the client for a newer one
    bytes: int = 0  # of headers and arrays sent; of arrays in shared memory too
    malformed: int = 0
    returned: int = 0
    t1: LatencyHistogram = field(default_factory=LatencyHistogram)  # bench sends to client has it
    t2: LatencyHistogram = field(default_factory=LatencyHistogram)  # the client's function
    t3: LatencyHistogram = field(default_factory=LatencyHistogram)  # client sends to bench has it
    round_trip: LatencyHistogram = field(default_factory=LatencyHistogram)  # bench sends to bench has the answer
    overhead: LatencyHistogram = field(default_factory=LatencyHistogram)  # bench sets about sending to answer, less t2
    clock_offset_ns: int = 0  # client's clock minus the bench's, the last reading
    clock_delay_ns: int | None = None  # its uncertainty is half of this; None before the first


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
        self.word = ""  # by which it is known beside ZeroMQ
        self.ways_needed: frozenset[str] = frozenset()  # groups in which it is to have a way beside ZeroMQ
        self.ways: dict[str, Way] = {}
        self.address = ""
        self.user = ""  # public key, where there is one

    @property
    def ready(self) -> bool:
        """Whether frames can go: it has said on every sensor's port, or beside ZeroMQ, who it is."""
        if self.ways_needed:
            return self.ways_needed <= self.ways.keys()
        return self.groups <= self.ports.keys()

    @property
    def way(self) -> Way | None:
        """On which it is heard, where that is not ZeroMQ."""
        return self.ways.get(CONTROL)

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

    def info(self) -> ClientInfo:
        return ClientInfo(self.name, self.topics, self.control, self.credit, self.address, self.stats.returned)


class Clients:
    """Who is here, who was, and strangers that have sent nothing sensible yet."""

    def __init__(self) -> None:
        self.by_name: dict[str, Client] = {}
        self._by_identity: dict[bytes, Client] = {}
        self.stats: dict[str, ClientStats] = {}
        self.lost: dict[str, str] = {}  # why, by name; those that came back are not in it
        self._names: dict[int, tuple[bytes, str]] = {}  # by connection: who has had a place there
        self._strangers: OrderedDict[bytes, int] = OrderedDict()

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
        self._strangers.pop(client.identity, None)
        if self.lost.pop(client.name, None) is not None:
            client.stats.returned += 1

    def remove(self, client: Client, why: str) -> None:
        if self.by_name.get(client.name) is client:
            del self.by_name[client.name]
            self.lost[client.name] = why
        self._by_identity.pop(client.identity, None)

    def strike(self, identity: bytes) -> int:
        """How many messages without sense this stranger has sent in a row, with this one. Few are remembered."""
        strikes = self._strangers.pop(identity, 0) + 1
        self._strangers[identity] = strikes
        while len(self._strangers) > _STRANGERS:
            self._strangers.popitem(last=False)
        return strikes
