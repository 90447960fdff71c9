"""The ways of a frame to a client: through the ring, whole over one socket, or by its sensors' ports. Never waits.

Over a socket a frame is one part of a message to ZeroMQ, or goes in pieces over a stream, where the client has one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from firmware_bridge.codecs.companion_frame import encode_frame, encode_frame_in_ring
from firmware_bridge.companion.bench_socket import BenchSocket
from firmware_bridge.companion.clients import Client, UnderWay
from firmware_bridge.companion.groups import CONTROL, group_of
from firmware_bridge.companion.newcomers import Way
from firmware_bridge.companion.outgoing import Outgoing
from firmware_bridge.companion.shared_ring import SharedRing
from firmware_bridge.companion.streams import Stream


class Sender:
    """Over these sockets, by group, and this ring, if there is one."""

    def __init__(
        self, sockets: Mapping[str, BenchSocket], ring: SharedRing | None, clock_ns: Callable[[], int]
    ) -> None:
        self._sockets, self._ring, self._clock_ns = sockets, ring, clock_ns

    def fill_ring(self, out: Outgoing, clients: list[Client]) -> int | None:
        """Copy in what these clients want of a frame: the slot; None if there is no room, or nobody wants it."""
        if not clients or self._ring is None:
            return None
        block = out.for_ring([client.topics for client in clients])
        return self._ring.put(block, [client.name for client in clients])

    def send(self, client: Client, out: Outgoing, slot: int | None, t_begun_ns: int) -> bool:
        """Whether there was room; else it counts as dropped. Unreachable if the client has gone."""
        if client.in_ring and slot is None:
            client.count_dropped()
            return False
        t_sent_ns = self._clock_ns()
        if slot is not None and client.way is not None:
            sent = self._send_in_ring(client, client.way, out, t_sent_ns, slot)
        elif client.groups:
            sent = self._send_by_ports(client, out, t_sent_ns)
        else:
            sent = self._send_whole(client, out, client.topics, CONTROL, t_sent_ns)
        if not sent:
            self.give_back(client, slot)
            client.count_dropped()
            return False
        client.credit -= 1
        client.dropped_since = 0
        client.under_way[out.frame.frame] = UnderWay(t_begun_ns, t_sent_ns, slot if client.in_ring else None)
        client.stats.frames += 1
        return True

    def give_back(self, client: Client, slot: int | None) -> None:
        """The client has read the slot, or never will."""
        if self._ring is not None and slot is not None:
            self._ring.give_back(slot, client.name)

    @staticmethod
    def _send_in_ring(client: Client, way: Way, out: Outgoing, t_sent_ns: int, slot: int) -> bool:
        f = out.frame
        offset, length, size = out.in_ring(client.topics)
        packet = encode_frame_in_ring(
            f.frame,
            f.tick,
            f.t_ns,
            t_sent_ns=t_sent_ns,
            dropped=client.dropped_since,
            release=slot,
            samples_at=(offset, length),
        )
        client.stats.bytes += len(packet) + length + size
        return way.send(packet)

    def _send_by_ports(self, client: Client, out: Outgoing, t_sent_ns: int) -> bool:
        topics = sorted(client.topics & out.topics)
        if not topics:
            return self._send_whole(client, out, client.topics, CONTROL, t_sent_ns)
        groups = [frozenset(topic for topic in topics if group_of(topic) == group) for group in client.groups]
        # Small ones first: they are read while the large ones are being sent.
        groups = sorted(filter(None, groups), key=lambda mine: (out.packed(mine)[1].size, min(mine)))
        sent = True
        for mine in groups:
            sent = self._send_whole(client, out, mine, group_of(min(mine)), t_sent_ns, ports_of_frame=topics) and sent
        return sent

    def _send_whole(
        self,
        client: Client,
        out: Outgoing,
        topics: frozenset[str],
        group: str,
        t_sent_ns: int,
        *,
        ports_of_frame: list[str] | None = None,
    ) -> bool:
        samples, block = out.packed(topics)
        f = out.frame
        header = encode_frame(
            f.frame,
            f.tick,
            f.t_ns,
            t_sent_ns=t_sent_ns,
            dropped=client.dropped_since,
            samples=samples,
            ports_of_frame=ports_of_frame,
        )
        client.stats.bytes += len(header) + block.size
        way = client.ways.get(group)
        if isinstance(way, Stream):
            return way.send_frame(header, block.pieces(), block.size)
        identity = client.identity if group == CONTROL else client.ports[group][0]
        return self._sockets[group].send(identity, [header, *out.together(topics)])
