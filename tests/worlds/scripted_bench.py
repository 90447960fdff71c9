"""A scripted bench for tests of the companion client: a ROUTER socket in a thread that follows a script."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zmq

ROOT = Path(__file__).resolve().parents[2]
CLIENT = ROOT / "rigs" / "jetson"
if str(CLIENT) not in sys.path:
    sys.path.insert(0, str(CLIENT))

from hil_companion import Client  # noqa: E402

from tests.worlds.patience import PATIENCE_S  # noqa: E402

LIMIT_S = PATIENCE_S  # a script that waits longer for its client fails
SESSION = "0123456789abcdef"
END = {"k": "end", "status": "PASS", "text": "over"}
RGB = np.arange(36, dtype="<u1").reshape(3, 4, 3)
DEPTH = np.linspace(0.0, 1.0, 40_000, dtype="<f4").reshape(200, 200)

Header = dict[str, Any]


def welcome(**changes: Any) -> Header:
    header: Header = {
        "k": "welcome",
        "version": 3,
        "schema": "a" * 16,
        "session": SESSION,
        "mode": "lockstep",
        "tick_ns": 4_000_000,
        "rate_hz": 10.0,
        "topics": {"imu": {"type": "ImuSample", "fields": {"accel_mps2": ["m/s2", "B"]}}},
        "sensors": {"front": {"size": [4, 3]}},
        "waypoints_W": [[0.0, 0.0, 2.0], [5.0, 0.0, 2.0]],
        "ports": {},
        "ring": None,
        "control": True,
    }
    return header | changes


def frame(number: int, samples: list[Header] | None = None, **changes: Any) -> Header:
    header: Header = {
        "k": "frame",
        "frame": number,
        "tick": number * 25,
        "t_ns": number * 100_000_000,
        "t_sent_ns": 1,
        "dropped": 0,
        "samples": samples or [],
        "release": 0,
    }
    return header | changes


def sample(topic: str, *, values: Header | None = None, arrays: list[Header] | None = None, seq: int = 0) -> Header:
    return {
        "topic": topic,
        "seq": seq,
        "t_capture_ns": 0,
        "t_available_ns": 0,
        "values": values or {},
        "arrays": arrays or [],
    }


def array(name: str, values: np.ndarray, offset: int = 0) -> Header:
    return {"name": name, "dtype": values.dtype.str, "shape": list(values.shape), "offset": offset}


def picture(number: int, **changes: Any) -> Header:
    """Frame header of one camera sample: RGB and, 64 bytes into the second part, DEPTH."""
    arrays = [array("rgb", RGB), array("depth", DEPTH, 64)]
    return frame(number, [sample("front/rgb", values={"k": 2.5}, arrays=arrays, seq=number)], **changes)


def together(*arrays: np.ndarray) -> bytes:
    """Concatenate the bytes of arrays, each padded to a multiple of 64."""
    return b"".join(np.ascontiguousarray(a).tobytes() + bytes(-a.nbytes % 64) for a in arrays)


def pack(header: Any) -> bytes:
    return msgpack.packb(header, use_bin_type=True)


class Bench:
    """One socket of a bench. `got` holds every header that came except pings, which are answered at once."""

    def __init__(self, context: zmq.Context[Any], address: str) -> None:
        self.got: list[Header] = []
        self.socket = context.socket(zmq.ROUTER)
        self.socket.linger = 500
        self.socket.rcvtimeo = int(LIMIT_S * 1000)
        self.address = address
        if address == "tcp":
            self.address = f"tcp://127.0.0.1:{self.socket.bind_to_random_port('tcp://127.0.0.1')}"
        else:
            self.socket.bind(address)

    def receive(self, kind: str) -> tuple[bytes, Header]:
        """Wait for the next message of that kind; return the client's identity and the header."""
        while True:
            identity, raw = self.socket.recv_multipart()
            header = msgpack.unpackb(raw)
            if header["k"] == "ping":
                now_ns = time.monotonic_ns() + 7_000_000_000  # a clock that differs from the client's
                pong = {"k": "pong", "id": header["id"], "t_client_ns": header["t_client_ns"]}
                self.send(identity, pong | {"t_bench_received_ns": now_ns, "t_bench_sent_ns": now_ns})
                continue
            self.got.append(header)
            if header["k"] == kind:
                return identity, header

    def send(self, identity: bytes, header: Header | bytes, *arrays: np.ndarray) -> None:
        first = header if isinstance(header, bytes) else pack(header)
        self.socket.send_multipart([identity, first, *([together(*arrays)] if arrays else [])])

    def greet(self, **changes: Any) -> bytes:
        identity, _ = self.receive("hello")
        self.send(identity, welcome(**changes))
        return identity

    def of_kind(self, kind: str) -> list[Header]:
        return [header for header in self.got if header["k"] == kind]


def connect(bench: Bench, **options: Any) -> Client:
    return Client.connect(bench.address, **{"name": "test", "wait_s": PATIENCE_S, **options})


@contextmanager
def running(script: Callable[[Bench], None], address: str = "tcp") -> Iterator[Bench]:
    """Run the script as the bench while the test plays the client; an error in the script fails the test."""
    context: zmq.Context[Any] = zmq.Context()
    bench = Bench(context, address)
    faults: list[BaseException] = []

    def follow() -> None:
        try:
            script(bench)
        except BaseException as fault:  # noqa: BLE001 (raised again below)
            faults.append(fault)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield bench
        thread.join(LIMIT_S)
        assert not thread.is_alive(), "the bench's script did not end"
    finally:
        bench.socket.close()
        context.destroy(linger=0)
    if faults:
        raise faults[0]
