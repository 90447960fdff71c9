"""The companion server with well-behaved clients: welcome, frames, answers, arrangements, clocks, keys."""

from __future__ import annotations

import math
import os
import stat
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import zmq

from firmware_bridge.codecs.companion import (
    TopicSchema,
    desired_from_map,
    desired_map,
    schema_hash,
)
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.clients import ClockOffset
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from firmware_bridge.companion.keys import make_keys, read_allowed, read_bench_keys
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.shared_ring import Block, SharedRing
from signals.desired import DesiredState, Knot
from signals.errors import ConfigError, HandshakeError, LinkClosed, PortBusy
from tests.worlds.companion_server import (
    FACTS,
    TOPICS,
    RawClient,
    answered,
    arrays_of,
    frame_of,
    join,
    serving,
    step,
    told,
    until,
)
from tests.worlds.patience import PATIENCE_S


def test_welcome_tells_the_session() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        welcome = join(server, client, topics=["front/*", "imu"], control=True)
        assert welcome["schema"] == schema_hash(TOPICS)
        assert welcome["session"] == server.session
        assert len(welcome["session"]) == 16
        assert sorted(welcome["topics"]) == ["front/depth", "front/rgb", "imu"]
        assert welcome["topics"]["front/depth"]["fields"]["depth"] == ["m", "z of C"]
        assert welcome["sensors"] == {"front": {"size": [4, 3]}, "imu": {}}
        assert welcome["waypoints_W"] == [[0.0, 0.0, 2.0], [5.0, 0.0, 2.0]]
        assert (welcome["mode"], welcome["ports"], welcome["ring"], welcome["control"]) == ("lockstep", {}, None, True)
        assert server.topics == {"front/depth", "front/rgb", "imu"}
        (info,) = server.clients
        assert (info.name, info.control, info.credit, info.returned) == ("cut", True, 2, 0)


def test_frame_arrives_whole_and_answer_returns() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, topics=["front/rgb", "imu", "baro"], control=True)
        assert server.send(frame_of(7)) == ["cut"]
        header, parts = client.receive()
        assert (header["frame"], header["tick"], header["t_ns"], header["dropped"]) == (7, 70, 280_000_000, 0)
        assert [s["topic"] for s in header["samples"]] == ["front/rgb", "imu", "baro"]
        for sample in header["samples"][:2]:
            (a,) = sample["arrays"]
            got = np.ndarray(a["shape"], a["dtype"], parts[0], a["offset"])
            np.testing.assert_array_equal(got, arrays_of(7)[a["name"]], strict=True)
        assert header["samples"][2]["values"] == {"pressure_pa": 101325.0}
        client.done(7, t2_ns=5, desired={"p_W": [1, 2.5, 3], "yaw_rad": 0.5}, finished=True)
        (reply,) = answered(server)
        assert (reply.client, reply.frame, reply.t2_ns, reply.finished) == ("cut", 7, 5, True)
        assert reply.desired == DesiredState(p_W=(1.0, 2.5, 3.0), yaw_rad=0.5)
        assert reply.t_arrived_ns > header["t_sent_ns"]


def test_frames_use_up_credits_and_dropped_frames_are_reported() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, credit=2)
        sent = [server.send(frame_of(k)) for k in range(5)]
        assert sent == [["cut"], ["cut"], [], [], []]
        client.expect("frame")
        client.expect("frame")
        client.done(0)
        answered(server)
        assert server.send(frame_of(5)) == ["cut"]
        header = client.expect("frame")
        assert (header["frame"], header["dropped"]) == (5, 3)
        client.say("credit", n=1)
        until(server, lambda: server.clients[0].credit == 1)
        assert server.send(frame_of(6)) == ["cut"]
        assert client.expect("frame")["dropped"] == 0
        client.done(6)  # 1 and 5 are skipped
        (reply,) = answered(server)
        assert reply.frame == 6
        stats = server.stats()["cut"]
        assert (stats.frames, stats.dropped) == (4, 3)


def test_several_ports_each_carry_their_sensor() -> None:
    with serving(arrangement="ports") as server, RawClient(server.endpoint) as client:
        client.hello(topics=["front/*", "baro"])
        until(server, lambda: server.topics != frozenset())
        ports = client.expect("welcome")["ports"]
        assert ports["front/rgb"] == ports["front/depth"] != ports["baro"]
        assert server.ready_names == ()  # no client is known on those ports yet
        with RawClient(ports["baro"]) as baro, RawClient(ports["front/rgb"]) as front:
            baro.hello(topics=["front/*", "baro"])
            front.hello(topics=["front/*", "baro"])
            until(server, lambda: server.ready_names == ("cut",))
            assert server.send(frame_of(3)) == ["cut"]
            whole = ["baro", "front/depth", "front/rgb"]
            header, parts = front.receive()
            assert [s["topic"] for s in header["samples"]] == ["front/rgb", "front/depth"]
            assert (header["frame"], header["ports_of_frame"], len(parts)) == (3, whole, 1)
            header, parts = baro.receive()
            assert [s["topic"] for s in header["samples"]] == ["baro"]
            assert (header["frame"], header["ports_of_frame"], len(parts)) == (3, whole, 0)
            client.done(3)
            answered(server)
            front.close()
            until(server, lambda: server.ready_names == ())  # frames would not be whole
            assert server.send(frame_of(4)) == []
            with RawClient(ports["front/rgb"]) as again:
                again.hello(topics=["front/*", "baro"])
                until(server, lambda: server.ready_names == ("cut",))
                assert server.send(frame_of(5)) == ["cut"]
                assert again.expect("frame")["dropped"] == 1


def test_shared_memory_is_read_in_place_and_given_back(tmp_path: Path) -> None:
    bind = f"ipc://{tmp_path}/bench"
    with (
        serving(arrangement="shared_memory", bind=bind, ring_bytes=8192) as server,
        RawClient(bind) as client,
        RawClient(bind) as other,
        RawClient(bind) as far,
    ):
        assert join(server, client, credit=64)["ring"]["bytes"] == 8192
        join(server, other, "other", credit=64, topics=["imu"])
        assert join(server, far, "far", credit=64, shared_memory=False)["ring"] is None
        sent = 0
        while server.send(frame_of(sent)) == ["cut", "other", "far"]:
            sent += 1
        headers = [client.receive()[0] for _ in range(sent)]
        size = headers[1]["release"]  # offset of the second frame in the ring
        assert size == 64 + 64 + 128  # rgb, depth and accel_mps2, each rounded up to 64 bytes
        # The frames lie one after the other, as many as fit.
        assert [h["release"] for h in headers] == [k * size for k in range(8192 // size)]
        for k, header in enumerate(headers):
            seen = other.receive()[0]
            assert [s["topic"] for s in seen["samples"]] == ["imu"]
            for reader, told in ((client, header), (other, seen)):
                for array in (x for s in told["samples"] for x in s["arrays"]):
                    assert array["offset"] % 64 == 0
                    np.testing.assert_array_equal(reader.array(told, array), arrays_of(k)[array["name"]], strict=True)
        assert server.send(frame_of(50)) == ["far"]
        client.done(1)
        answered(server)
        assert server.send(frame_of(51)) == ["far"]  # the other still reads them
        other.done(1)
        answered(server)
        assert [server.send(frame_of(k)) for k in (52, 53, 54)] == [["cut", "other", "far"]] * 2 + [["far"]]
        assert client.receive()[0]["dropped"] == 3


@pytest.mark.parametrize("arrangement", ["shared_memory", "one_port"])
def test_messages_come_in_their_order_and_the_last_before_the_end(arrangement: str, tmp_path: Path) -> None:
    bind = f"ipc://{tmp_path}/bench" if arrangement == "shared_memory" else "tcp://127.0.0.1:*"
    with serving(arrangement=arrangement, bind=bind, ring_bytes=8192) as server, RawClient(server.endpoint) as client:
        join(server, client, credit=1)
        server.send(frame_of(0))
        client.expect("frame")
        client.say("ping", id=3, t_client_ns=5)
        client.done(0)
        client.say("bye", reason="enough")
        client.close(linger_ms=5000)
        (reply,) = answered(server)
        assert reply.frame == 0
        until(server, lambda: server.ready_names == ())
        assert server.lost == {"cut": "it left: enough"}
    with serving(arrangement=arrangement, bind=bind, ring_bytes=8192) as server, RawClient(server.endpoint) as client:
        join(server, client, credit=1)
        server.send(frame_of(0))
        client.done(0)  # unread by the bench as it ends
        server.close("over", "so it is")
        assert client.expect("frame")["frame"] == 0
        assert client.expect("end")["text"] == "so it is"


def blocks(*arrays: np.ndarray) -> Block:
    block = Block()
    for array in arrays:
        block.add(array)
    return block


def test_ring_goes_round_a_slot_that_is_not_given_back() -> None:
    ring = SharedRing(640)
    try:
        a = np.arange(16, dtype=np.int64)
        stuck = ring.put(blocks(a), ["stuck"])
        assert stuck is not None
        for _ in range(50):
            place = ring.put(blocks(a, a[:3]), ["x", "y"])
            assert place not in (None, stuck)
            ring.release(place, "x")
            assert ring.put(blocks(np.zeros(512, np.uint8)), ["x"]) is None  # y still holds it
            ring.release(place, "y")
        assert ring.put(blocks(np.zeros(640, np.uint8)), ["x"]) is None
        whole = ring.put(blocks(np.zeros(512, np.uint8)), ["x"])
        assert whole == 128
        name = ring.name
    finally:
        ring.close()
    assert not Path("/dev/shm", name).exists()
    ring.close()


def test_ping_is_answered_with_the_benchs_clock() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        client.say("ping", id=4, t_client_ns=123)
        pong = told(server, client, "pong")
        assert (pong["id"], pong["t_client_ns"]) == (4, 123)
        assert 0 < pong["t_bench_received_ns"] <= pong["t_bench_sent_ns"]


def test_clock_offset_takes_the_exchange_with_the_least_delay() -> None:
    clock = ClockOffset()
    assert clock.best is None
    for t_ns, there_ns, back_ns in ((0, 9_000, 100), (1_000_000, 300, 200), (2_000_000, 100, 5_000)):
        arrived_ns = t_ns + there_ns
        clock.add(t_ns, arrived_ns + 77_000, arrived_ns + 50_000 + 77_000, arrived_ns + 50_000 + back_ns)
    best = clock.best
    assert best is not None
    assert (best.offset_ns, best.delay_ns) == (77_050, 500)  # wrong by half the difference of the two delays
    clock.add(0, 10, 5, 100)
    clock.add(0, 0, 200, 100)
    assert clock.best == best  # impossible times
    clock.add_reading(3_000_000, 77_000, 10)
    again = clock.best
    assert again is not None
    assert again.offset_ns == 77_000


def test_best_clock_reading_of_the_window_allows_for_drift() -> None:
    clock = ClockOffset()
    readings: list[tuple[int, int, int]] = []
    rng = np.random.default_rng(3)
    for number, delay_ns in enumerate(rng.integers(1, 20_000, 400).tolist()):
        reading = (20_000_000 * number, number, delay_ns)
        readings.append(reading)
        clock.add_reading(*reading)
        now_ns = reading[0] + 5
        assert clock.best == min(readings[-64:], key=lambda r: r[2] + 2e-4 * (now_ns - r[0]))


def test_reply_times_allow_for_the_clients_clock() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        server.send(frame_of(0))
        sent_ns = client.expect("frame")["t_sent_ns"]
        ahead_ns = 10**15
        client.done(0, t_received_ns=sent_ns + ahead_ns, t_sent_ns=sent_ns + ahead_ns)
        (reply,) = answered(server)
        half_ns = (reply.t_arrived_ns - sent_ns) / 2
        assert reply.clock_offset_ns == pytest.approx(ahead_ns - half_ns, abs=2)
        there_ns = reply.t_received_ns - reply.clock_offset_ns - reply.t_frame_sent_ns
        back_ns = reply.t_arrived_ns - (reply.t_sent_ns - reply.clock_offset_ns)
        assert (there_ns, back_ns) == pytest.approx((half_ns, half_ns), abs=2)


def test_waiting_names_what_is_missing() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        client.hello(topics=["sonar"])
        calls: list[int] = []
        with pytest.raises(HandshakeError, match=r"0 of 2 clients.*no topic matches 'sonar'.*baro"):
            server.wait_for_clients(2, 1.0, lambda: calls.append(1))
        assert calls
        client.hello()
        assert [c.name for c in server.wait_for_clients(1, PATIENCE_S)] == ["cut"]


def test_after_limit_topics_a_later_client_gets_no_other_topics() -> None:
    with serving() as server, RawClient(server.endpoint) as first, RawClient(server.endpoint) as late:
        join(server, first, topics=["imu", "baro"])
        server.limit_topics(server.topics)
        late.hello("late", topics=["imu", "front/rgb"])
        refused = told(server, late, "refused")
        assert refused["code"] == "topic"
        assert "front/rgb" in refused["text"]
        join(server, late, "late", topics=["imu"])


def test_close_sends_the_result() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        server.close("FAIL", "too late")
        end = client.expect("end")
        assert (end["status"], end["text"]) == ("FAIL", "too late")
        assert server.poll(0.0) == []
        with pytest.raises(LinkClosed):
            server.send(frame_of(0))


def test_arrays_are_sent_in_c_order_and_little_endian() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        arrays = {
            "turned": np.arange(12, dtype=np.int16).reshape(3, 4).T,
            "big": np.arange(3, dtype=">f8"),
            "empty": np.zeros((0, 3), np.float32),
            "large": np.arange(100_000, dtype=np.uint32),  # past the size up to which pyzmq copies
            "scalar": np.array(2.5),
        }
        server.send(CompanionFrame(0, 0, 0, (CompanionSample("imu", 0, 0, 0, {}, arrays),)))
        header, parts = client.receive()
        for a in header["samples"][0]["arrays"]:
            got = np.ndarray(a["shape"], a["dtype"], parts[0], a["offset"])
            assert a["dtype"][0] in "<|"
            np.testing.assert_array_equal(got, arrays[a["name"]])
        points = np.zeros(2, [("x", "f4")])
        with pytest.raises(CodecError, match=r"imu\.points.*plain numeric array"):
            server.send(CompanionFrame(1, 1, 1, (CompanionSample("imu", 0, 0, 0, {}, {"points": points}),)))


def test_schema_changes_with_any_unit() -> None:
    other = dict(TOPICS) | {
        "baro": TopicSchema("BaroSample", dict(TOPICS["baro"].fields) | {"pressure_pa": ("hPa", "-")})
    }
    assert schema_hash(TOPICS) == schema_hash(dict(reversed(TOPICS.items())))
    hashes = [schema_hash(TOPICS), schema_hash(other), schema_hash({k: v for k, v in TOPICS.items() if k != "imu"})]
    assert all(a != b for a, b in pairwise(hashes))


def test_desired_state_survives_its_map() -> None:
    path = DesiredState(p_W=(1.0, 2.0, 3.0), a_W=(0.0, 0.0, -1.0), yaw_rad=0.5, land=True, hold=True)
    ahead = DesiredState(p_W=(1, 2, 3), v_W=(0, 0, 1), ahead=(Knot(0.5, (1, 2, 4), (0, 0, 2)),))
    attitude = DesiredState(q_WB=(0.6, 0.8, 0.0, 0.0), thrust=0.4, w_B=(0.0, 0.0, 0.1))
    for desired in (path, ahead, attitude):
        assert desired_from_map(desired_map(desired)) == desired
    for wrong in (3, [[0.1]], [[0.1, [0, 0], [0, 0, 0]]], [[math.nan, [0, 0, 0], [0, 0, 0]]], [0] * 99):
        with pytest.raises(CodecError, match="ahead"):
            desired_from_map(desired_map(ahead) | {"ahead": wrong})
    with pytest.raises(CodecError, match="thrust with p_W: either an attitude is flown, or a path"):
        desired_from_map(desired_map(path) | {"a_W": None, "yaw_rad": None, "thrust": 0.4, "w_B": [0.0, 0.0, 0.1]})


def test_key_files(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    made = make_keys(folder, ["a", "b"])
    assert sorted(f.name for f in made) == ["a.key", "a.pub", "b.key", "b.pub", "bench.key", "bench.pub"]
    assert all(stat.S_IMODE(f.stat().st_mode) == 0o600 for f in made if f.suffix == ".key")
    assert sorted(read_allowed(folder).values()) == ["a", "b"]
    assert zmq.curve_public(read_bench_keys(folder).secret) == read_bench_keys(folder).public
    before = {f: f.read_bytes() for f in made}
    with pytest.raises(ConfigError, match=r"a\.key: exists already"):
        make_keys(folder, ["c", "a"])
    assert {f: f.read_bytes() for f in folder.iterdir()} == before
    assert len(make_keys(folder, ["c"])) == 2
    for name in ("bench", "../x", ".hidden", "a/b", ""):
        with pytest.raises(ConfigError):
            make_keys(folder, [name])
    os.chmod(folder / "bench.key", 0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_bench_keys(folder)
    os.chmod(folder / "bench.key", 0o600)
    (folder / "bench.pub").write_bytes((folder / "a.pub").read_bytes())
    with pytest.raises(ConfigError, match="does not belong"):
        read_bench_keys(folder)
    (folder / "b.pub").write_text("# nothing\n")
    with pytest.raises(ConfigError, match="holds no key"):
        read_allowed(folder)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"bind": "tcp://0.0.0.0:5570"}, "hil keys"),
        ({"bind": "tcp://192.168.1.2:5570"}, "hil keys"),
        ({"bind": "tcp://bench.example:5570"}, "hil keys"),
        ({"bind": "tcp://*:5570"}, "hil keys"),
        ({"bind": "tcp://127.0.0.1"}, "HOST:PORT"),
        ({"bind": "udp://127.0.0.1:1"}, "tcp://"),
        ({"bind": "ipc:///tmp/x", "arrangement": "ports"}, "tcp://"),
        ({"arrangement": "shared_memory"}, "ipc://"),
        ({"max_clients": 33}, "1..32"),
    ],
)
def test_contradictory_settings_are_refused(settings: dict[str, object], match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        CompanionSettings(**settings)  # type: ignore[arg-type]


def test_port_in_use_is_named(tmp_path: Path) -> None:
    with serving() as first, pytest.raises(PortBusy, match="second bench"):
        CompanionServer(CompanionSettings(bind=first.endpoint), FACTS).open()
    bind = f"ipc://{tmp_path}/bench"
    with serving(bind=bind) as first, RawClient(bind) as client:
        with pytest.raises(PortBusy, match="second bench"):
            CompanionServer(CompanionSettings(bind=bind), FACTS).open()
        join(first, client)
        step(first, client, 0)


def test_control_is_refused_if_no_desired_state_is_flown() -> None:
    with serving(facts=replace(FACTS, control=False)) as server, RawClient(server.endpoint) as client:
        client.hello(topics=["imu"], control=True)
        until(server, lambda: bool(server.refused))
        refused = client.expect("refused")
        assert refused["code"] == "control"
        assert "companion.control is false" in refused["text"]
