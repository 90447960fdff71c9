"""Companion clients that break, stall, flood or send invalid messages: each is named or refused, others are unaffected.

Every test ends with a healthy client that is served as before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgpack
import numpy as np
import pytest

from firmware_bridge.codecs.companion import VERSION, Bye, Credit, Done, Hello, Ping, decode_client
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.keys import make_keys, read_pair
from firmware_bridge.companion.server import CompanionServer
from tests.worlds.companion_server import Events, RawClient, answered, frame_of, join, serving, step, told, until
from tests.worlds.patience import PATIENCE_S

NAN = float("nan")
DONE = {"k": "done", "frame": 0, "t_received_ns": 1, "t_sent_ns": 2, "t2_ns": 0, "desired": None, "finished": False}


@contextmanager
def healthy(server: CompanionServer) -> Iterator[Callable[[], None]]:
    """Yield a function that serves one more frame to a correct client, before and after the test as well."""
    with RawClient(server.endpoint) as client:
        join(server, client, "healthy", topics=["imu"])
        numbers = iter(range(100_000, 200_000))

        def fly() -> None:
            step(server, client, next(numbers), "healthy")

        fly()
        yield fly
        fly()
        stats = server.stats()["healthy"]
        assert (stats.malformed, stats.dropped, stats.returned) == (0, 0, 0)
        assert client.silent()  # no other client's messages reached it


def test_client_that_vanishes_mid_frame_is_lost_and_comes_back() -> None:
    events = Events()
    with serving(events) as server, healthy(server) as fly:
        with RawClient(server.endpoint) as client:
            join(server, client)
            server.send(frame_of(0), to=["cut"])
        until(server, lambda: "cut" in server.lost)
        assert server.lost["cut"] == "its connection ended"
        assert server.send(frame_of(1), to=["cut"]) == []
        fly()
        with RawClient(server.endpoint) as again:
            join(server, again)
            step(server, again, 2)
            assert (server.lost, server.stats()["cut"].returned) == ({}, 1)
        assert "cut (again, 4 topics)" in events.of("joined")


def test_stalled_client_is_dropped_by_the_caller_and_returns_on_the_same_connection() -> None:
    with serving() as server, healthy(server) as fly, RawClient(server.endpoint) as client:
        join(server, client)
        server.send(frame_of(0), to=["cut"])
        assert server.poll(0.05) == []
        server.drop("cut", "no answer within 0.05 s")
        assert server.lost == {"cut": "no answer within 0.05 s"}
        fly()
        client.expect("frame")
        client.done(0)  # too late
        assert client.expect("end")["status"] == "dropped"
        assert told(server, client, "refused")["code"] == "malformed"
        join(server, client)
        step(server, client, 1)
        server.drop("nobody", "is not here")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"magic": "other"}, "magic"),
        ({"magic": None}, "magic"),
        ({"version": 2}, "version"),  # a client of before
        ({"version": True}, "version"),
        ({"schema": "0123456789abcdef"}, "schema"),
        ({"schema": 5}, "malformed"),
        ({"topics": ["sonar"]}, "topic"),
        ({"topics": []}, "malformed"),
        ({"topics": ["*"] * 33}, "malformed"),
        ({"topics": "imu"}, "malformed"),
        ({"topics": ["imu\n"]}, "malformed"),
        ({"name": ""}, "name"),
        ({"name": "a" * 65}, "name"),
        ({"name": "a b"}, "name"),
        ({"name": "healthy"}, "name"),
        ({"control": 1}, "malformed"),
        ({"credit": 0}, "malformed"),
        ({"credit": -1}, "malformed"),
        ({"credit": 65}, "malformed"),
        ({"credit": 1.0}, "malformed"),
        ({"shared_memory": None}, "malformed"),
    ],
)
def test_invalid_hello_is_refused(change: dict[str, object], code: str) -> None:
    with serving() as server, healthy(server), RawClient(server.endpoint) as client:
        client.hello(**{"name": "cut", **change})  # type: ignore[arg-type]
        until(server, lambda: not client.silent(0.0))
        refused = client.expect("refused")
        assert refused["code"] == code, refused
        assert refused["text"]
        join(server, client)  # a second, valid hello


def test_the_number_of_clients_and_of_pilots_is_limited() -> None:
    with serving(max_clients=2) as server, healthy(server), RawClient(server.endpoint) as pilot:
        join(server, pilot, "pilot", control=True)
        with RawClient(server.endpoint) as third:
            third.hello("third")
            until(server, lambda: not third.silent(0.0))
            assert third.expect("refused")["code"] == "full"
        pilot.say("bye", reason="")
        until(server, lambda: "pilot" in server.lost)
        join(server, pilot, "pilot", control=True)
    with serving() as server, healthy(server), RawClient(server.endpoint) as one, RawClient(server.endpoint) as two:
        join(server, one, "one", control=True)
        two.hello("two", control=True)
        until(server, lambda: not two.silent(0.0))
        assert two.expect("refused")["code"] == "control"
        until(server, lambda: "two" not in server.ready_names)


@pytest.mark.parametrize(
    "change",
    [
        {"frame": 99},
        {"frame": -1},
        {"frame": True},
        {"t_sent_ns": -5},
        {"t2_ns": 1.5},
        {"finished": None},
        {"desired": []},
        {"desired": {"p_W": [0, 0, NAN]}},
        {"desired": {"p_W": [0, 0]}},
        {"desired": {"v_W": [0, float("inf"), 0]}},
        {"desired": {"yaw_rad": "north"}},
        {"desired": {"q_WB": [1, 0, 0, 0.1]}},
        {"desired": {"q_WB": [0, 0, 0, 0]}},
        {"desired": {"thrust": 1.01}},
        {"desired": {"land": 1}},
        {"desired": {"speed": 1}},
        {"desired": {"a_W": [1e300, 0, 0]}},
    ],
)
def test_invalid_answer_is_refused_and_the_valid_one_after_it_counts(change: dict[str, object]) -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, control=True)
        server.send(frame_of(0))
        client.expect("frame")
        client.say(**{"kind": "done", **{k: v for k, v in DONE.items() if k != "k"}, **change})  # type: ignore[arg-type]
        assert until(server, lambda: not client.silent(0.0)) == []
        assert client.expect("refused")["code"] == "malformed"
        assert [(c.name, c.credit) for c in server.clients] == [("cut", 1)]
        client.done(0)
        assert answered(server)[0].frame == 0
        assert server.stats()["cut"].malformed == 1
        client.done(0)  # a second answer gives no second credit
        until(server, lambda: server.stats()["cut"].malformed == 2)
        assert [(c.name, c.credit) for c in server.clients] == [("cut", 2)]


def test_commands_need_control_and_credits_have_a_limit() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, credit=60)
        server.send(frame_of(0))
        client.expect("frame")
        client.done(0, desired={"p_W": [0, 0, 1]})
        assert until(server, lambda: not client.silent(0.0)) == []
        assert "no control" in client.expect("refused")["text"]
        for n in (6, 0, -3, 65, 2**40, None):
            client.say("credit", n=n)
            until(server, lambda: not client.silent(0.0))
            assert client.expect("refused")["code"] == "malformed", n
        assert [(c.name, c.credit) for c in server.clients] == [("cut", 59)]
        client.say("credit", n=5)
        until(server, lambda: [(c.name, c.credit) for c in server.clients] == [("cut", 64)])


@pytest.mark.parametrize("key", ["other key", "no key", "wrong bench"])
def test_wrong_keys_are_refused_and_the_right_one_is_served(key: str, tmp_path: Path) -> None:
    make_keys(tmp_path / "bench", ["cut"])
    make_keys(tmp_path / "other", ["cut"])
    right, other = read_pair(tmp_path / "bench", "cut"), read_pair(tmp_path / "other", "cut")
    bench, wrong_bench = read_pair(tmp_path / "bench", "bench"), read_pair(tmp_path / "other", "bench")
    good = {"curve_serverkey": bench.public, "curve_publickey": right.public, "curve_secretkey": right.secret}
    bad: dict[str, dict[str, bytes]] = {
        "other key": good | {"curve_publickey": other.public, "curve_secretkey": other.secret},
        "no key": {},
        "wrong bench": good | {"curve_serverkey": wrong_bench.public},
    }
    events = Events()
    with (
        serving(events, keys=tmp_path / "bench") as server,
        RawClient(server.endpoint, **good) as client,
        RawClient(server.endpoint, **bad[key]) as stranger,
    ):
        stranger.hello("stranger")
        join(server, client)
        until(server, lambda: bool(events.of("wire")))
        step(server, client, 0)
        assert ("key is not among" if key == "other key" else "failed in the handshake") in events.of("wire")[0]
        assert server.ready_names == ("cut",)
        assert stranger.silent()


def test_unknown_client_on_a_sensors_port_gets_nothing() -> None:
    with serving(arrangement="ports") as server, RawClient(server.endpoint) as client:
        client.hello(topics=["imu"])
        until(server, lambda: server.topics == {"imu"})
        port = client.expect("welcome")["ports"]["imu"]
        with RawClient(port) as imu, RawClient(port) as thief:
            thief.hello("thief", topics=["imu"])
            until(server, lambda: not thief.silent(0.0))
            assert thief.expect("refused")["code"] == "name"
            imu.hello(topics=["imu"])
            until(server, lambda: server.ready_names == ("cut",))
            thief.hello(topics=["imu"])  # another's name
            until(server, lambda: not thief.silent(0.0))
            assert thief.expect("refused")["code"] == "name"
            server.send(frame_of(0))
            assert imu.expect("frame")["frame"] == 0
            assert thief.silent()


def test_close_does_not_wait_for_clients_that_do_not_read() -> None:
    with serving() as server, RawClient(server.endpoint, rcvhwm=1, rcvbuf=4096) as client:
        join(server, client, credit=64)
        for k in range(64):
            server.send(frame_of(k))
        began_s = time.monotonic()
        server.close()
        assert time.monotonic() - began_s < PATIENCE_S  # it ends at all: not a measurement
        server.close()


def test_decoder_raises_only_its_own_error() -> None:
    good = [
        DONE,
        {"k": "credit", "n": 3},
        {"k": "ping", "id": 1, "t_client_ns": 5},
        {"k": "bye", "reason": "x"},
        {"k": "hello", "magic": "hil-companion", "version": VERSION, "schema": None, "name": "a", "topics": ["*"]}
        | {"control": True, "credit": 1, "shared_memory": False},
    ]
    kinds = (Done, Credit, Ping, Bye, Hello)
    rng = np.random.default_rng(11)
    for message, kind in zip(good, kinds, strict=True):
        raw = msgpack.packb(message)
        assert isinstance(decode_client(raw), kind)
        for _ in range(1500):
            damaged = bytearray(raw)
            for _ in range(int(rng.integers(1, 4))):
                damaged[int(rng.integers(0, len(damaged)))] = int(rng.integers(0, 256))
            damaged = damaged[: int(rng.integers(0, len(damaged) + 1))] if rng.random() < 0.3 else damaged
            with suppress(CodecError):
                assert isinstance(decode_client(bytes(damaged)), kinds)
    deep = b"\x91" * 100_000
    for raw in (b"", deep, b"\x81\xa1k" + deep, b"\xdf\xff\xff\xff\xff", b"\xd4\xff\x00"):
        with pytest.raises(CodecError):
            decode_client(raw)
