"""Frames by plain TCP beside ZeroMQ: the server with raw clients, the client with a raw bench, and the two together."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.server import CompanionServer
from hil.companion.started import use_client
from tests.links.companion_world import (
    WAIT_S,
    RawClient,
    answered,
    arrays_of,
    frame_of,
    join,
    serving,
    step,
    until,
)

use_client()
from hil_companion import stream as client_stream  # noqa: E402
from hil_companion.client import Client  # noqa: E402
from hil_companion.errors import ConnectionLost  # noqa: E402

LENGTHS = struct.Struct("<IQ")


class RawStream:
    """A connection to where a welcome told."""

    def __init__(self, streams: Mapping[str, Any], group: str = "", word: str | None = None) -> None:
        self.wire = socket.create_connection(tuple(streams["addresses"][group]), WAIT_S)
        self.say_bytes((streams["word"] if word is None else word).encode())

    def say_bytes(self, message: bytes, body: bytes = b"") -> None:
        self.wire.sendall(LENGTHS.pack(len(message), len(body)) + message + body)

    def say(self, kind: str, **entries: Any) -> None:
        self.say_bytes(msgpack.packb({"k": kind, **entries}))

    def done(self, frame: int) -> None:
        now_ns = time.monotonic_ns()
        times = {"t_received_ns": now_ns, "t_sent_ns": now_ns, "t2_ns": 0}
        self.say("done", frame=frame, desired=None, finished=False, **times)

    def receive(self) -> tuple[dict[str, Any], bytes]:
        header_bytes, body_bytes = LENGTHS.unpack(self._exactly(LENGTHS.size))
        header = msgpack.unpackb(self._exactly(header_bytes))
        for sample in header.get("samples", ()):
            sample["arrays"] = msgpack.unpackb(sample["arrays"])
        return header, self._exactly(body_bytes)

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            more = self.wire.recv(size - len(data))
            assert more, "the bench ended the connection"
            data += more
        return data


def enter(server: CompanionServer, client: RawClient, **changes: Any) -> dict[str, RawStream]:
    """Welcomed, and on all its streams."""
    client.hello(stream=True, **changes)
    until(server, lambda: not client.silent(0.0))
    streams = client.expect("welcome")["streams"]
    opened = {group: RawStream(streams, group) for group in streams["addresses"]}
    until(server, lambda: changes.get("name", "cut") in server.living)
    return opened


def assert_arrives(header: Mapping[str, Any], body: bytes, number: int, names: list[str]) -> None:
    described = [array for sample in header["samples"] for array in sample["arrays"]]
    assert [array["name"] for array in described] == names
    for array in described:
        got = np.ndarray(array["shape"], array["dtype"], body, array["offset"])
        np.testing.assert_array_equal(got, arrays_of(number)[array["name"]], strict=True)


# --- the bench's end ---


def test_frame_goes_by_the_stream_and_its_answer_comes_back_there() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        stream = enter(server, client)[""]
        assert server.send(frame_of(7)) == ["cut"]
        header, body = stream.receive()
        assert (header["frame"], len(header["samples"])) == (7, 4)
        assert_arrives(header, body, 7, ["rgb", "depth", "accel_mps2"])
        stream.done(7)
        assert answered(server)[0].frame == 7
        assert client.silent()
        server.close("PASS", "over")
        assert stream.receive()[0] == {"k": "end", "status": "PASS", "text": "over"}


def test_each_sensor_has_a_stream_where_it_has_a_port() -> None:
    with serving(arrangement="ports") as server, RawClient(server.endpoint) as client:
        streams = enter(server, client, topics=["front/*", "imu"])
        assert sorted(streams) == ["", "front", "imu"]
        assert len({s.wire.getpeername()[1] for s in streams.values()}) == 3
        server.send(frame_of(3))
        for group, names in (("front", ["rgb", "depth"]), ("imu", ["accel_mps2"])):
            header, body = streams[group].receive()
            assert header["ports_of_frame"] == ["front/depth", "front/rgb", "imu"]
            assert_arrives(header, body, 3, names)
        streams[""].done(3)
        assert answered(server)[0].frame == 3
        streams["imu"].wire.close()
        until(server, lambda: "cut" in server.lost)


def large_frame(number: int) -> CompanionFrame:
    pixels = np.random.default_rng(number).integers(0, 255, (2000, 1500, 3), np.uint8)
    return CompanionFrame(number, number, number, (CompanionSample("front/rgb", 1, 1, 1, {}, {"rgb": pixels}),))


def test_what_the_kernel_does_not_take_goes_later_and_nobody_waits() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        stream = enter(server, client, topics=["front/rgb"], credit=4)[""]
        frames = [large_frame(number) for number in range(4)]  # 36 MB, more than the kernel holds
        began_s = time.monotonic()
        assert [server.send(frame) for frame in frames] == [["cut"]] * 4
        assert time.monotonic() - began_s < WAIT_S / 2
        for frame in frames:
            frame.samples[0].arrays["rgb"][...] = 0  # what was not taken has been copied
        got: list[tuple[dict[str, Any], bytes]] = []
        reading = threading.Thread(target=lambda: got.extend(stream.receive() for _ in range(4)))
        reading.start()
        until(server, lambda: not reading.is_alive())
        for number, (header, body) in enumerate(got):
            assert header["frame"] == number
            assert body[:9_000_000] == large_frame(number).samples[0].arrays["rgb"].tobytes()
        stream.done(3)
        assert answered(server)[0].frame == 3


def test_nobody_comes_in_without_the_word() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        client.hello(stream=True)
        until(server, lambda: not client.silent(0.0))
        streams = client.expect("welcome")["streams"]
        strangers = [RawStream(streams, word=word) for word in ("?" * 32, "")]
        for stranger in strangers:
            stranger.wire.settimeout(0.02)
            until(server, lambda stranger=stranger: _ended(stranger))  # type: ignore[misc]
        assert server.living == ()
        stream = RawStream(streams)
        until(server, lambda: server.living == ("cut",))
        second = RawStream(streams)  # the word is good once
        second.wire.settimeout(0.02)
        until(server, lambda: _ended(second))
        server.send(frame_of(0))
        assert stream.receive()[0]["frame"] == 0


def _ended(stream: RawStream) -> bool:
    try:
        return stream.wire.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True


@pytest.mark.parametrize(
    "sent",
    [
        LENGTHS.pack(65_537, 0),  # a header beyond the limit
        LENGTHS.pack(10, 1) + bytes(11),  # a body
        b"\xff" * 100_000,
    ],
)
def test_what_is_no_message_ends_the_place_and_disturbs_nobody(sent: bytes) -> None:
    with serving() as server, RawClient(server.endpoint) as client, RawClient(server.endpoint) as other:
        stream = enter(server, client)[""]
        join(server, other, "other")
        stream.wire.sendall(sent)
        until(server, lambda: "cut" in server.lost)
        assert server.lost["cut"].startswith("it sent what is no message")
        step(server, other, 0, "other")
        enter(server, client)  # and it may come back
        assert server.stats()["cut"].returned == 1


def test_nonsense_in_whole_messages_is_refused_ten_times() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        stream = enter(server, client)[""]
        for k in range(10):
            stream.say_bytes(b"\xc1")
            until(server, lambda k=k: server.malformed > k)  # type: ignore[misc]
        assert "cut" in server.lost
        assert stream.receive()[0]["code"] == "malformed"


def test_flood_that_is_never_read_out_is_held_back_by_the_kernel() -> None:
    """Pings, legal ones, as fast as it goes: the other client is served all the same."""
    with serving() as server, RawClient(server.endpoint) as client, RawClient(server.endpoint) as other:
        stream = enter(server, client)[""]
        join(server, other, "other")
        ping = msgpack.packb({"k": "ping", "id": 1, "t_client_ns": 1})
        flood = (LENGTHS.pack(len(ping), 0) + ping) * 20_000
        stop = threading.Event()

        def pour() -> None:
            with stream.wire:
                while not stop.is_set():
                    try:
                        stream.wire.send(flood)
                    except OSError:
                        return

        stream.wire.settimeout(0.05)
        pouring = threading.Thread(target=pour)
        pouring.start()
        try:
            for number in range(5):
                step(server, other, number, "other")
        finally:
            stop.set()
            pouring.join()


def test_streams_are_offered_where_nobody_else_can_listen(tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", ["cut"])
    with serving(keys=tmp_path / "keys") as server:
        assert server._wires.streams == {}
    with serving(arrangement="shared_memory", bind=f"ipc://{tmp_path}/s", ring_bytes=8192) as server:
        assert server._wires.streams == {}
    with serving(bind="tcp://[::1]:*") as server:
        assert server._wires.streams[""].address[0] == "::1"


# --- the two together ---


@contextmanager
def client_thread(server: CompanionServer, frames: int, **options: Any) -> Iterator[list[Any]]:
    """The client's library, which answers so many frames; what it got."""
    got: list[Any] = []
    leave = threading.Event()

    def serve() -> None:
        with Client.connect(server.endpoint, name="cut", wait_s=WAIT_S, **options) as client:
            got.append(client.welcome)
            for _ in range(frames):
                frame = client.receive(WAIT_S)
                assert frame is not None
                got.append(frame)
                client.done(frame)
            leave.wait(WAIT_S)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        until(server, lambda: "cut" in server.living)
        yield got
        leave.set()
        until(server, lambda: not thread.is_alive())
    finally:
        leave.set()
        thread.join(WAIT_S)


@pytest.mark.parametrize("arrangement", ["one_port", "ports"])
@pytest.mark.parametrize("stream", [True, False])
def test_client_and_server_agree(arrangement: str, stream: bool) -> None:
    with serving(arrangement=arrangement) as server, client_thread(server, 20, stream=stream) as got:
        for number in range(20):
            assert server.send(frame_of(number)) == ["cut"]
            assert answered(server)[0].frame == number
    welcome, *frames = got
    assert (welcome.streams is not None, bool(welcome.ports)) == (stream, not stream and arrangement == "ports")
    for number, frame in enumerate(frames):
        arrays = {name: array for sample in frame.samples.values() for name, array in sample.arrays.items()}
        assert (frame.frame, frame.in_ring, len(frame)) == (number, False, 4)
        for name, array in arrays_of(number).items():
            np.testing.assert_array_equal(arrays[name], array, strict=True)
            assert not arrays[name].flags.writeable


def test_client_does_without_where_its_streams_cannot_be_reached() -> None:
    """As through a tunnel, which leads to the one port."""
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        closed = nobody.getsockname()
    with serving() as server:
        server._wires.streams[""].address = closed
        with client_thread(server, 1) as got:
            assert server.send(frame_of(0)) == ["cut"]
            answered(server)
        assert got[0].streams is None
        assert server.stats()["cut"].frames == 1


# --- the client's end ---


@contextmanager
def raw_bench() -> Iterator[tuple[socket.socket, client_stream.Stream]]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        stream = client_stream.Stream("127.0.0.1", listening.getsockname()[1], "word", 1 << 20)
        wire, _ = listening.accept()
        with wire:
            assert wire.recv(100) == LENGTHS.pack(4, 0) + b"word"
            try:
                yield wire, stream
            finally:
                stream.close()


def next_of(stream: client_stream.Stream) -> list[bytes]:
    end_s = time.monotonic() + WAIT_S
    while True:
        parts = stream.receive()
        if parts is not None:
            stream.finish()
            return [bytes(part) for part in parts]
        assert time.monotonic() < end_s


def test_messages_are_put_together_however_they_come() -> None:
    rng = np.random.default_rng(5)
    sent = [(rng.bytes(h), rng.bytes(b)) for h, b in ((1, 0), (300, 5), (20_000, 70_000), (8192, 0), (7, 8192), (0, 3))]
    whole = b"".join(LENGTHS.pack(len(h), len(b)) + h + b for h, b in sent)
    for piece in (len(whole), 4096, 13):
        with raw_bench() as (wire, stream):

            def pour(wire: socket.socket = wire, piece: int = piece) -> None:
                for at in range(0, len(whole), piece):
                    wire.sendall(whole[at : at + piece])

            pouring = threading.Thread(target=pour)
            pouring.start()
            assert [next_of(stream) for _ in sent] == [[h, b] if b else [h] for h, b in sent]
            pouring.join()
            assert stream.receive() is None


def test_end_within_a_frame_is_a_loss() -> None:
    with raw_bench() as (wire, stream):
        wire.sendall(LENGTHS.pack(2, 1000) + b"ab" + bytes(500))
        wire.close()
        with pytest.raises(ConnectionLost):
            next_of(stream)


def test_frame_that_stands_still_is_a_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_stream, "WAIT_S", 0.1)
    with raw_bench() as (wire, stream):
        wire.sendall(LENGTHS.pack(2, 1000) + b"ab" + bytes(500))
        with pytest.raises(ConnectionLost, match="rest of a frame"):
            next_of(stream)


@pytest.mark.parametrize("lengths", [((1 << 20) + 1, 0), (10, (1 << 20) + 1)])
def test_lengths_beyond_the_limits_are_a_loss(lengths: tuple[int, int]) -> None:
    with raw_bench() as (wire, stream):
        wire.sendall(LENGTHS.pack(*lengths))
        with pytest.raises(ConnectionLost, match="a message of"):
            next_of(stream)
