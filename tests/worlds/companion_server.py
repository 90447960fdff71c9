"""A companion server in this process, and raw clients that can send any bytes."""

from __future__ import annotations

import mmap
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zmq

from firmware_bridge.codecs.companion import VERSION, topic_schema
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample, Reply, SessionFacts
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.companion.settings import CompanionSettings
from signals.samples import BaroSample, ImageSample, ImuSample
from tests.worlds.patience import PATIENCE_S

WAIT_S = PATIENCE_S
TOPICS = {
    "front/rgb": topic_schema(ImageSample, "rgb"),
    "front/depth": topic_schema(ImageSample, "depth"),
    "imu": topic_schema(ImuSample),
    "baro": topic_schema(BaroSample),
}
FACTS = SessionFacts(
    TOPICS, "lockstep", 4_000_000, 100.0, {"front": {"size": [4, 3]}, "imu": {}}, ((0.0, 0.0, 2.0), (5.0, 0.0, 2.0))
)


class Events(list[tuple[str, str]]):
    """Callbacks that record what the server reports."""

    def __call__(self, kind: str, text: str) -> None:
        self.append((kind, text))

    def of(self, kind: str) -> list[str]:
        return [text for k, text in self if k == kind]


@contextmanager
def serving(events: Events | None = None, facts: SessionFacts = FACTS, **settings: Any) -> Iterator[CompanionServer]:
    """Run a server on any free port of the loopback interface."""
    settings = {"bind": "tcp://127.0.0.1:*", **settings}
    server = CompanionServer(CompanionSettings(**settings), facts, on_event=events)
    server.open()
    try:
        yield server
    finally:
        server.close("PASS", "the test is over")


class RawClient:
    """A raw client: a DEALER socket without the client package."""

    def __init__(self, address: str, **options: Any) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.DEALER)
        self.socket.linger = 0
        for name, value in options.items():
            setattr(self.socket, name, value)
        self.socket.connect(address)
        self.memory: mmap.mmap | None = None

    def map(self, ring: Mapping[str, Any]) -> None:
        """Map the ring that a welcome names."""
        with Path("/dev/shm", ring["name"]).open("rb") as file:
            self.memory = mmap.mmap(file.fileno(), ring["bytes"], access=mmap.ACCESS_READ)

    def send(self, *parts: bytes) -> None:
        self.socket.send_multipart(parts)

    def say(self, kind: str, **entries: Any) -> None:
        self.send(msgpack.packb({"k": kind, **entries}))

    def hello(self, name: str = "cut", **changes: Any) -> None:
        entries: dict[str, Any] = {
            "magic": "hil-companion",
            "version": VERSION,
            "schema": None,
            "name": name,
            "topics": ["*"],
            "control": False,
            "credit": 2,
            "shared_memory": True,
        }
        self.say("hello", **{**entries, **changes})

    def done(self, frame: int, **changes: Any) -> None:
        now_ns = time.monotonic_ns()
        entries = {"t_received_ns": now_ns, "t_sent_ns": now_ns, "t2_ns": 0, "desired": None, "finished": False}
        self.say("done", frame=frame, **{**entries, **changes})

    def receive(self, wait_s: float = WAIT_S) -> tuple[dict[str, Any], list[bytes]]:
        """Receive a header and the other parts."""
        if self.silent(wait_s):
            raise AssertionError("nothing came")
        parts = self.socket.recv_multipart()
        header = msgpack.unpackb(parts[0])
        return header, parts[1:]

    def array(self, header: Mapping[str, Any], described: Mapping[str, Any]) -> np.ndarray:
        """Return a copy of an array in the ring."""
        at = header["release"] + described["offset"]
        return np.ndarray(described["shape"], described["dtype"], self.memory, at).copy()

    def expect(self, kind: str) -> dict[str, Any]:
        header, _ = self.receive()
        assert header["k"] == kind, header
        return header

    def silent(self, wait_s: float = 0.05) -> bool:
        return not self.socket.poll(wait_s * 1000)

    def close(self, linger_ms: int = 0) -> None:
        self.context.destroy(linger=linger_ms)

    def __enter__(self) -> RawClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def until(server: CompanionServer, what: Callable[[], bool], limit_s: float = WAIT_S) -> list[Reply]:
    """Serve until `what` returns True; return the replies of that time."""
    replies: list[Reply] = []
    end_s = time.monotonic() + limit_s
    while not what():
        assert time.monotonic() < end_s, "it did not happen"
        replies += server.poll(0.005)
    return replies


def told(server: CompanionServer, client: RawClient, kind: str) -> dict[str, Any]:
    """Serve until a client has received a message, which must be of this kind; return its header."""
    until(server, lambda: not client.silent(0.0))
    return client.expect(kind)


def answered(server: CompanionServer, count: int = 1) -> list[Reply]:
    replies: list[Reply] = []
    end_s = time.monotonic() + WAIT_S
    while len(replies) < count:
        assert time.monotonic() < end_s, f"{len(replies)} of {count} replies"
        replies += server.poll(0.05)
    return replies


def join(server: CompanionServer, client: RawClient, name: str = "cut", **changes: Any) -> dict[str, Any]:
    """Connect a client and return its welcome."""
    client.hello(name, **changes)
    until(server, lambda: not client.silent(0.0))
    welcome = client.expect("welcome")
    if welcome["ring"] is not None:
        client.map(welcome["ring"])
    until(server, lambda: name in server.ready_names)
    return welcome


def step(server: CompanionServer, client: RawClient, number: int, name: str = "cut") -> Reply:
    """Send one frame to a client and return its answer."""
    assert name in server.send(frame_of(number), to=[name])
    header = client.expect("frame")
    assert header["frame"] == number
    client.done(number)
    reply = answered(server)[0]
    assert (reply.client, reply.frame) == (name, number)
    return reply


def arrays_of(number: int) -> Mapping[str, np.ndarray]:
    rng = np.random.default_rng(number)
    return {
        "rgb": rng.integers(0, 255, (3, 4, 3), np.uint8),
        "depth": rng.random((3, 4), np.float32),
        "accel_mps2": rng.random((5, 3)),
    }


def frame_of(number: int) -> CompanionFrame:
    a = arrays_of(number)
    return CompanionFrame(
        number,
        10 * number,
        40_000_000 * number,
        (
            CompanionSample("front/rgb", number, 1, 2, {"p_WC": [1.0, 2.0, 3.0]}, {"rgb": a["rgb"]}),
            CompanionSample("front/depth", number, 1, 2, {}, {"depth": a["depth"]}),
            CompanionSample("imu", number, 3, 4, {}, {"accel_mps2": a["accel_mps2"]}),
            CompanionSample("baro", number, 3, 4, {"pressure_pa": 101325.0}),
        ),
    )
