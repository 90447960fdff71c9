"""The companion client against a scripted bench: frames, credits, barrier, refusals, garbage, losses, keys."""

from __future__ import annotations

import math
import threading
import time
from multiprocessing import shared_memory
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zmq
from zmq.auth.thread import ThreadAuthenticator

from tests.worlds.patience import PATIENCE_S, raised_by
from tests.worlds.scripted_bench import (
    DEPTH,
    END,
    RGB,
    Bench,
    array,
    connect,
    frame,
    pack,
    picture,
    running,
    sample,
    welcome,
)

from hil_companion import Client, Desired  # isort: skip
from hil_companion.errors import (  # isort: skip
    BadMessage,
    CompanionError,
    ConnectionLost,
    CutError,
    NoBench,
    OptionError,
    Refused,
    SchemaChanged,
    WrongKeys,
)


@pytest.mark.parametrize("way", ["tcp", "ipc"])
def test_a_frame_arrives_whole_and_its_arrays_are_views_of_what_was_received(way: str, tmp_path: Path) -> None:
    def script(bench: Bench) -> None:
        client = bench.greet()
        bench.send(client, picture(0), RGB, DEPTH)
        bench.receive("done")
        bench.send(client, END)

    with running(script, "tcp" if way == "tcp" else f"ipc://{tmp_path}/b") as bench:
        with connect(bench, topics=["front/*"], credit=3) as client:
            frames = list(client.frames())
        assert client.end is not None
        assert client.end.text == "over"
    (only,) = frames
    got = only["front/rgb"]
    np.testing.assert_array_equal(got["rgb"], RGB)
    np.testing.assert_array_equal(got["depth"], DEPTH)
    assert got["k"] == 2.5
    for name in ("rgb", "depth"):
        view = got[name]
        assert not view.flags.owndata
        assert not view.flags.writeable
        base = view
        while isinstance(base, np.ndarray):
            base = base.base
        assert isinstance(base, zmq.Frame)  # the message itself, not a copy of it
    (hello,) = bench.of_kind("hello")
    assert (hello["topics"], hello["credit"], hello["schema"]) == (["front/*"], 3, None)
    (done,) = bench.of_kind("done")
    assert done["desired"] is None
    assert done["t_sent_ns"] >= done["t_received_ns"] == only.t_received_ns


def test_an_answer_carries_what_is_desired_and_a_frame_is_answered_once() -> None:
    def script(bench: Bench) -> None:
        client = bench.greet()
        bench.send(client, frame(0))
        bench.receive("done")
        bench.send(client, END)

    with running(script) as bench, connect(bench, control=True) as client:
        first = client.receive(PATIENCE_S)
        assert first is not None
        client.done(first, Desired(p_W=np.array([1, 2, 3.0]), yaw_rad=0.5), t2_ns=77, finished=True)
        with pytest.raises(CompanionError, match="answered before"):
            client.done(first)
        assert client.receive(PATIENCE_S) is None
        assert client.clock.bench_minus_client_ns == pytest.approx(7e9, abs=1e9)
    (done,) = bench.of_kind("done")
    assert done["desired"] == {"p_W": [1.0, 2.0, 3.0], "yaw_rad": 0.5}
    assert (done["t2_ns"], done["finished"]) == (77, True)


def test_a_client_without_control_cannot_command() -> None:
    def script(bench: Bench) -> None:
        bench.send(bench.greet(control=False), frame(0))
        bench.receive("bye")

    with running(script) as bench, connect(bench) as client:
        first = client.receive(PATIENCE_S)
        assert first is not None
        with pytest.raises(CutError, match="without control"):
            client.done(first, Desired(land=True))


def test_frames_over_several_ports_are_put_together_whatever_the_order() -> None:
    topics = ["front/rgb", "lidar"]
    context: zmq.Context[Any] = zmq.Context()
    ports = [Bench(context, "tcp"), Bench(context, "tcp")]
    rows = np.arange(6, dtype="<f4").reshape(2, 3)

    def script(bench: Bench) -> None:
        client = bench.greet(ports={t: p.address for t, p in zip(topics, ports, strict=True)}, control=False)
        ids = []
        for port in ports:
            identity, hello = port.receive("hello")
            assert hello["session"] == welcome()["session"]
            assert hello["name"] == "test"
            ids.append(identity)

        def part(i: int, number: int) -> None:
            header = frame(number, [sample(topics[i], arrays=[array("a", rows)])], ports_of_frame=topics)
            ports[i].send(ids[i], header, rows + number)

        part(0, 0)
        part(1, 1)  # a part of the next frame, before the rest of this one
        part(1, 0)
        assert bench.receive("done")[1]["frame"] == 0
        part(0, 1)
        assert bench.receive("done")[1]["frame"] == 1
        part(0, 2)  # never completed
        part(0, 3)
        part(1, 3)
        assert bench.receive("credit")[1]["n"] == 1  # for the dropped frame
        assert bench.receive("done")[1]["frame"] == 3
        part(1, 2)  # too late
        part(0, 4)
        part(1, 4)
        assert bench.receive("done")[1]["frame"] == 4
        bench.send(client, END)

    try:
        with running(script) as bench, connect(bench, credit=4) as client:
            seen = {}
            for whole in client.frames():
                assert sorted(whole) == sorted(topics)
                seen[whole.frame] = float(whole["lidar"]["a"][0, 0])
            assert seen == {0: 0.0, 1: 1.0, 3: 3.0, 4: 4.0}
            assert client.barrier.incomplete == 1
            assert client.barrier.late == 1
    finally:
        context.destroy(linger=0)


def test_arrays_in_shared_memory_are_read_in_place_and_the_memory_outlives_the_client() -> None:
    memory = shared_memory.SharedMemory(create=True, size=1 << 20)
    try:
        slot = np.frombuffer(memory.buf, "<f4", 40_000, offset=4096)
        slot[:] = DEPTH.ravel()

        def told(number: int, release: int, offset: int = 1024) -> dict[str, Any]:
            at = {"name": "depth", "dtype": "<f4", "shape": [200, 200], "offset": offset}
            return frame(number, [sample("front/depth", arrays=[at])], release=release)

        def script(bench: Bench) -> None:
            client = bench.greet(ring={"name": memory.name, "bytes": memory.size})
            bench.send(client, told(0, (1 << 20) - 2048))  # reaches beyond the ring
            bench.send(client, told(0, -3072))
            bench.send(client, told(1, 3072))
            bench.receive("done")
            assert len(bench.of_kind("credit")) == 2  # for the frames that could not be read
            bench.send(client, END)

        with running(script) as bench, connect(bench) as client:
            first = client.receive(PATIENCE_S)
            assert first is not None
            assert first.frame == 1
            assert client.malformed == 2
            view, kept = first["front/depth"].array, first.copy()["front/depth"].array
            np.testing.assert_array_equal(view, DEPTH)
            slot[0] = 42.0
            assert view[0, 0] == 42.0  # in place
            assert kept[0, 0] == 0.0
            assert not view.flags.writeable
            assert not kept.flags.writeable
            client.done(first)
            assert client.receive(PATIENCE_S) is None
            assert client.end is not None
        assert Path("/dev/shm", memory.name.lstrip("/")).exists()
        del view, slot
    finally:
        memory.close()
        memory.unlink()


def test_each_refusal_is_told_with_its_code() -> None:
    codes = ["magic", "version", "topic", "name", "control", "full", "malformed"]

    def script(bench: Bench) -> None:
        for code in [*codes, "schema"]:
            identity, _ = bench.receive("hello")
            bench.send(identity, {"k": "refused", "code": code, "text": f"because of {code}"})

    with running(script) as bench:
        for code in codes:
            with pytest.raises(Refused, match=f"because of {code}") as caught:
                connect(bench)
            assert caught.value.code == code
        with pytest.raises(SchemaChanged, match="because of schema"):
            connect(bench, schema="b" * 16)
    assert bench.of_kind("hello")[-1]["schema"] == "b" * 16


def damaged() -> list[list[bytes]]:
    """Return frame headers that a client must refuse."""
    at = array("a", np.zeros(3, "<f4"))
    bad = [
        {"dtype": "O"},
        {"dtype": "<f4,<f4"},
        {"dtype": ">f4"},
        {"shape": [4]},
        {"shape": [-3]},
        {"shape": [2**40, 2**40]},
        {"shape": [1.5]},
        {"offset": -1},
        {"offset": 1},
        {"offset": None},
    ]
    headers = [frame(1, [sample("t", arrays=[at | change])]) for change in bad]
    headers += [frame(1, [sample("t", arrays=[at, at])]), frame(1, [sample("t"), sample("t")])]
    headers += [
        frame(-1),
        frame(1, tick="x"),
        frame(1) | {"samples": {}},
        frame(1, t_ns=True),
        {"k": "frame"},
        {"k": "hm"},
    ]
    raw = [b"", b"\xc1", b"\x80", b"[]", pack({"k": 3}), bytes(1 << 21), b"\x91" * 5000]
    return [[pack(h), bytes(12)] for h in headers] + [[r] for r in raw]


def test_garbage_is_counted_and_the_next_good_frame_is_taken() -> None:
    bad = damaged()

    def script(bench: Bench) -> None:
        client = bench.greet()
        for i, parts in enumerate(bad):
            bench.socket.send_multipart([client, *parts])
            if i % 5 == 4:
                bench.send(client, picture(i), RGB, DEPTH)
                bench.receive("done")
        bench.send(client, picture(100), RGB, DEPTH)
        bench.receive("done")
        bench.send(client, END)

    with running(script) as bench, connect(bench) as client:
        taken = [f.frame for f in client.frames()]
        assert taken == [*range(4, len(bad), 5), 100]
        assert client.malformed == len(bad)


def test_nothing_but_garbage_is_an_error() -> None:
    def script(bench: Bench) -> None:
        client = bench.greet()
        for _ in range(10):
            bench.send(client, b"\xc1")
        bench.receive("bye")

    with running(script) as bench, connect(bench) as client, pytest.raises(BadMessage, match="10 unusable"):
        list(client.frames())


def test_a_welcome_that_is_none_is_refused_field_by_field() -> None:
    wrong: list[dict[str, Any]] = [
        {"version": 2},
        {"schema": 3},
        {"mode": "fast"},
        {"tick_ns": 0},
        {"rate_hz": math.nan},
        {"topics": []},
        {"topics": {"imu": {}}},
        {"sensors": {"front": 1}},
        {"waypoints_W": [[0, 0]]},
        {"waypoints_W": [[0, 0, math.inf]]},
        {"ports": {"imu": 5}},
        {"ring": {"name": "../etc", "bytes": 10}},
        {"ring": {"name": "x", "bytes": -1}},
        {"control": 1},
    ]

    def script(bench: Bench) -> None:
        for changes in wrong:
            bench.greet(**changes)

    with running(script) as bench:
        for changes in wrong:
            with pytest.raises(BadMessage, match=next(iter(changes))):
                connect(bench)


def test_a_message_past_the_limit_costs_the_connection_not_the_memory() -> None:
    def script(bench: Bench) -> None:
        client = bench.greet()
        bench.send(client, frame(0), np.zeros(1 << 20, np.uint8))

    with (
        running(script) as bench,
        connect(bench, max_message_bytes=1 << 16) as client,
        pytest.raises(ConnectionLost, match="lost"),
    ):
        list(client.frames())


def test_no_bench_and_an_unresponsive_bench_are_two_errors() -> None:
    with pytest.raises(NoBench, match="no bench there"):
        Client.connect("tcp://127.0.0.1:1", name="x", wait_s=0.2)

    def script(bench: Bench) -> None:
        bench.receive("hello")

    with running(script) as bench, pytest.raises(NoBench, match="did not answer"):
        connect(bench, wait_s=0.5)


@pytest.mark.parametrize(
    "options",
    [
        {"name": "a b"},
        {"name": ""},
        {"credit": 0},
        {"credit": 65},
        {"topics": []},
        {"topics": "imu"},
        {"key": "x"},
        {"address": "nonsense"},
        {"key": "/nowhere/a.key", "bench_key": "/nowhere/b.pub"},
    ],
)
def test_wrong_options_are_told_before_anything_is_sent(options: dict[str, Any]) -> None:
    given = {"address": "tcp://127.0.0.1:1", "name": "x", "wait_s": 0.1} | options
    with pytest.raises(OptionError):
        Client.connect(given.pop("address"), **given)


# --- keys ---


def write_key(path: Path, key: bytes, mode: int = 0o600) -> Path:
    path.write_text(f"# a key for a test\n{key.decode()}\n")
    path.chmod(mode)
    return path


def test_curve_admits_valid_keys_and_names_the_error_otherwise(tmp_path: Path) -> None:
    bench_public, bench_secret = zmq.curve_keypair()
    public, secret = zmq.curve_keypair()
    stranger_public, stranger_secret = zmq.curve_keypair()
    good = {"key": write_key(tmp_path / "a.key", secret), "bench_key": write_key(tmp_path / "b.pub", bench_public)}
    unknown = good | {"key": write_key(tmp_path / "s.key", stranger_secret)}
    other_bench = good | {"bench_key": write_key(tmp_path / "s.pub", stranger_public)}

    context: zmq.Context[Any] = zmq.Context()
    guard = ThreadAuthenticator(context)
    guard.start()
    socket = context.socket(zmq.ROUTER)
    socket.rcvtimeo = 5000
    try:
        allowed = SimpleNamespace(callback=lambda _domain, key: key == public)
        guard.configure_curve_callback(credentials_provider=allowed)
        socket.curve_server, socket.curve_secretkey, socket.curve_publickey = True, bench_secret, bench_public
        address = f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
        for wrong, words in ((unknown, "does not allow"), (other_bench, "public key"), ({}, "requires keys")):
            with pytest.raises(WrongKeys, match=words):
                Client.connect(address, name="x", wait_s=PATIENCE_S, **wrong)

        def answer() -> None:
            identity, _ = socket.recv_multipart()
            socket.send_multipart([identity, pack(welcome())])

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        try:
            Client.connect(address, name="x", wait_s=PATIENCE_S, **good).close()
        finally:
            thread.join(PATIENCE_S)
    finally:
        guard.stop()
        context.destroy(linger=0)
    with pytest.raises(OptionError, match="chmod 600"):
        Client.connect("tcp://127.0.0.1:1", name="x", **(good | {"key": write_key(tmp_path / "o.key", secret, 0o644)}))


def test_a_client_that_is_stopped_while_it_makes_its_socket_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(zmq.Socket, "get_monitor_socket", stopped)
    error = raised_by(lambda: Client.connect("tcp://127.0.0.1:1", name="x", topics=["imu"]))
    assert isinstance(error, KeyboardInterrupt)


def test_desired_states_are_checked_when_made() -> None:
    wrong: list[dict[str, Any]] = [
        {"p_W": (1, 2)},
        {"v_W": "abc"},
        {"a_W": (1, 2, math.inf)},
        {"yaw_rad": "north"},
        {"thrust": 1.01},
        {"q_WB": (1, 1, 0, 0)},
        {"w_B": 3},
        {"land": 1},
        {"p_W": (1e10, 0, 0)},
    ]
    for entries in wrong:
        with pytest.raises(CutError, match=next(iter(entries))):
            Desired(**entries)
    assert Desired().as_map() == {}
    assert Desired(q_WB=(1, 0, 0, 0), thrust=np.float32(0.5), land=True).as_map() == {
        "q_WB": [1.0, 0.0, 0.0, 0.0],
        "thrust": 0.5,
        "land": True,
    }


def test_a_frame_not_come_in_time_is_a_loss_for_who_asks() -> None:
    def script(bench: Bench) -> None:
        bench.greet()
        bench.receive("bye")

    with running(script) as bench, connect(bench) as client:
        began_s = time.monotonic()
        assert client.receive(0.05) is None
        assert time.monotonic() - began_s >= 0.05
        with pytest.raises(ConnectionLost, match="no frame within"):
            list(client.frames(timeout_s=0.05))
