"""The answer to a frame: checked against what was sent, measured, and counted."""

from __future__ import annotations

from firmware_bridge.codecs.companion import MAX_CREDIT, Done
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.clients import Client
from firmware_bridge.companion.frames import Reply
from firmware_bridge.companion.sender import Sender

_CLOCKS_APART_NS = 1_000_000  # how much longer than here a function may seem to have taken by another clock


def take_answer(client: Client, done: Done, t_ns: int, sender: Sender) -> Reply:
    """What a client says of a frame, counted, its room in the ring and its credit given back. CodecError: no answer."""
    if done.frame not in client.under_way:
        raise CodecError(f"done: frame {done.frame} was not sent, or has been answered")
    if done.desired is not None and not client.control:
        raise CodecError("done: a desired state of a client that has no control")
    if done.detections is not None and done.detections.topic not in client.topics:
        raise CodecError(f"done: detections in {done.detections.topic[:60]!a}, a topic that it does not get")
    sent = client.under_way[done.frame]
    if done.t2_ns > t_ns - sent.t_sent_ns + _CLOCKS_APART_NS:
        raise CodecError(f"done: t2_ns {done.t2_ns} is longer than the frame was away, {t_ns - sent.t_sent_ns}")
    stats = client.stats
    # Frames are answered in order: what is older, the client has passed over.
    for number in [n for n in client.under_way if n <= done.frame]:
        sender.give_back(client, client.under_way.pop(number).slot)
        stats.skipped += number != done.frame
    client.credit = min(client.credit + 1, MAX_CREDIT)
    client.clock.add(sent.t_sent_ns, done.t_received_ns, done.t_sent_ns, t_ns)
    reading = client.clock.best
    offset_ns = 0 if reading is None else reading.offset_ns
    stats.answered += 1
    stats.clock_offset_ns = offset_ns
    stats.clock_delay_ns = None if reading is None else reading.delay_ns
    stats.t1.add(done.t_received_ns - offset_ns - sent.t_sent_ns)
    stats.t2.add(done.t2_ns)
    stats.t3.add(t_ns - (done.t_sent_ns - offset_ns))
    stats.round_trip.add(t_ns - sent.t_sent_ns)
    stats.overhead.add(t_ns - sent.t_begun_ns - done.t2_ns)
    return Reply(
        client.name,
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
