"""What the companion server bears of clients that send legal messages with extreme contents, or too many of them."""

from __future__ import annotations

import msgpack
import pytest

from firmware_bridge.codecs.companion import decode_client
from firmware_bridge.codecs.errors import CodecError
from tests.links.companion_world import RawClient, answered, frame_of, join, serving, step, until

MAX_INT = 2**63 - 1


def test_times_at_the_end_of_64_bits_are_counted() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        client.say("ping", id=1, t_client_ns=0, bench_minus_client_ns=2**62, round_trip_ns=0)
        server.poll(0.2)
        client.expect("pong")
        server.send(frame_of(0))
        client.expect("frame")
        client.done(0, t_received_ns=2**62, t_sent_ns=2**62)
        (reply,) = answered(server)
        assert reply.clock_offset_ns == -(2**62)
        assert server.stats()["cut"].t1.max_ns == pytest.approx(2**63 - 1, rel=1e-3)
        client.done(1)
        server.poll(0.2)
        assert client.expect("refused")["code"] == "malformed"
        step(server, client, 2)


@pytest.mark.parametrize(
    "message",
    [
        {"k": "ping", "id": 1, "t_client_ns": 1, "bench_minus_client_ns": MAX_INT, "round_trip_ns": 0},
        {"k": "ping", "id": 1, "t_client_ns": 1, "bench_minus_client_ns": 0, "round_trip_ns": MAX_INT},
        {"k": "ping", "id": 1, "t_client_ns": MAX_INT},
        {"k": "done", "frame": 0, "t_received_ns": MAX_INT, "t_sent_ns": 0, "t2_ns": 0, "finished": False},
        {"k": "done", "frame": 0, "t_received_ns": 0, "t_sent_ns": MAX_INT, "t2_ns": 0, "finished": False},
        {"k": "done", "frame": 0, "t_received_ns": 0, "t_sent_ns": 0, "t2_ns": MAX_INT, "finished": False},
    ],
)
def test_times_beyond_146_years_are_malformed(message: dict[str, object]) -> None:
    with pytest.raises(CodecError, match="no whole number within"):
        decode_client(msgpack.packb(message))


def test_function_cannot_have_taken_longer_than_the_frame_was_away() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        server.send(frame_of(0))
        client.expect("frame")
        client.done(0, t2_ns=3_600_000_000_000)
        until(server, lambda: server.malformed == 1)
        assert "t2_ns" in client.expect("refused")["text"]
        client.done(0)  # it can still be answered
        answered(server)
        assert server.stats()["cut"].t2.max_ns == 0
