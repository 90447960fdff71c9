"""What a newcomer is told with its welcome: the run, its topics, and the ways on which its frames will come."""

from __future__ import annotations

from firmware_bridge.codecs.companion import Ring, Streams, Welcome
from firmware_bridge.companion.clients import Client
from firmware_bridge.companion.frames import SessionFacts
from firmware_bridge.companion.groups import group_of
from firmware_bridge.companion.wires import Wires


def welcome_of(client: Client, facts: SessionFacts, wires: Wires, *, session: str, schema: str) -> Welcome:
    """For this client."""
    topics = sorted(client.topics)
    sensors = {group_of(topic) for topic in topics}
    by_ports = client.groups and not client.ways_needed
    return Welcome(
        schema=schema,
        session=session,
        mode=facts.mode,
        tick_ns=facts.tick_ns,
        rate_hz=facts.rate_hz,
        topics={name: facts.topics[name] for name in topics},
        sensors={name: values for name, values in facts.sensors.items() if name in sensors},
        waypoints_W=facts.waypoints_W,
        ports={topic: wires.sockets[group_of(topic)].endpoint for topic in topics} if by_ports else {},
        ring=_ring(client, wires),
        streams=_streams(client, wires),
        control=client.control,
        views_every_ns=facts.views_every_ns,
    )


def _ring(client: Client, wires: Wires) -> Ring | None:
    if not client.in_ring or wires.ring is None or wires.doors is None:
        return None
    return Ring(wires.ring.name, wires.ring.size, wires.doors.path, client.word)


def _streams(client: Client, wires: Wires) -> Streams | None:
    if client.in_ring or not client.ways_needed:
        return None
    return Streams(client.word, {group: wires.streams[group].address for group in sorted(client.ways_needed)})
