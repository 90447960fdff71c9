"""Transfer benchmark: frames of one megabyte between two hosts, over the companion link and over a bare TCP socket.

The link is timed from `CompanionServer.send` to the client's `done`, with the same arrays each time and with keys
(CURVE). The bare socket sends the bytes of a frame's arrays, joined in advance, in one `sendall`, receives them into an
existing buffer and answers with 20 bytes, without headers, checks or encryption. Link and socket are measured in turn
between the same two processes in short blocks, so that other load on the machine affects both. Each pair of blocks
gives a ratio of rates; the result is the median ratio. The error of the link is the number of arrays that do not arrive
as they were sent.

The far process runs this module with the arguments ADDRESS HOST:PORT SCALE [KEY BENCH_KEY]. It answers every frame on
the link, and on the bare socket every time that it has received the bytes of a frame. Its answers to the first frames
report how many arrays differ from those that it generates itself.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.codecs.companion import topic_schema
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample, SessionFacts
from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.companion.settings import Arrangement, CompanionSettings
from hil.apps.bench_suite.link.second_host import second_host
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.config.companion.clients import CLIENT_PATH
from signals.errors import LinkClosed, PortNotFound
from signals.samples import ImageSample, PointCloudSample

Arrays = dict[str, dict[str, NDArray[Any]]]  # topic -> name -> array

LIMIT_S = 20.0  # for connecting and for each answer
MAX_IN_FLIGHT = 4  # unanswered frames in streaming mode
_MODES = {"stop-and-wait": 1, "streaming": MAX_IN_FLIGHT}
_NETWORK_ARRANGEMENTS: tuple[Arrangement, ...] = ("one_port", "ports")
_MIN_RELATIVE_RATE = 0.8
_COMPARED_FRAMES = 3
_ANSWER_BYTES = 20
_BLOCK_S = 0.02
_TICK_NS = 10_000_000
_CAMERA = ("rgb", "depth", "segmentation")
_POSE = {"p_W": [1.0, 2.0, 3.0], "q_WB": [1.0, 0.0, 0.0, 0.0]}
_ROOT = Path(__file__).resolve().parents[4]


def measure_transfers(result: BenchmarkResult, folder: Path, status: ShowStatus, *, seconds: float) -> None:
    """Measure each arrangement and mode for `seconds`; without a second host, list the checks as left out.

    Raises LinkClosed or HandshakeError if the link breaks.
    """
    with ExitStack() as stack:
        try:
            host = stack.enter_context(second_host())
        except PortNotFound as error:
            result.left_out.append(f"companion: transfers between two hosts ({error})")
            return
        if not host.delayed:
            result.left_out.append("companion: 0.2 ms of delay between the two hosts (this kernel has no netem)")
        make_keys(folder / "keys", ["peer"])
        for arrangement in _NETWORK_ARRANGEMENTS:
            status(f"transfers between two hosts, {arrangement}")
            with open_transfer(Endpoints(host.bench_address, host.command, folder / "keys"), arrangement) as transfer:
                _measure(result, transfer, arrangement, seconds)


def _measure(result: BenchmarkResult, transfer: Transfer, arrangement: str, seconds: float) -> None:
    case, differing_count = "transfer, two hosts", transfer.differing
    for mode, in_flight in _MODES.items():
        rates = transfer.measure(in_flight=in_flight, seconds=seconds)
        bare = f"bare socket beside {arrangement}"
        for method, error, blocks in ((arrangement, differing_count, rates.link_s), (bare, 0, rates.bare_s)):
            frame_s = median(blocks)
            details = {
                "frames_per_s": 1.0 / frame_s,
                "mb_per_s": rates.payload_bytes / frame_s / 1e6,
                "blocks": len(blocks),
                "load_average": os.getloadavg()[0],  # shows other load on the machine
            }
            result.rows.append(Row(f"{case}, {mode}", method, error, "arrays", frame_s, details))
        name = f"{case}, {arrangement}, {mode}: rate relative to the bare socket"
        result.checks.append(Check(name, rates.relative_rate, ">=", _MIN_RELATIVE_RATE, "1", "speed"))
    result.checks.append(Check(f"{case}, {arrangement}: arrays that differ", differing_count, "<=", 0, "arrays"))


def frame_arrays(seed: int, scale: float = 1.0) -> Arrays:
    """Return a frame of about 1 MB of noise: RGB, depth and segmentation of 320x240 and a LiDAR sweep of 16x900.

    `scale` multiplies the number of rows.
    """
    rng = np.random.default_rng(seed)
    rows, n = max(1, round(240 * scale)), max(1, round(16 * 900 * scale))
    return {
        "front/rgb": {"rgb": rng.integers(0, 256, (rows, 320, 3), np.uint8)},
        "front/depth": {"depth": rng.random((rows, 320), np.float32)},
        "front/segmentation": {"segmentation": rng.integers(0, 256, (rows, 320), np.uint8)},
        "lidar": {
            "points_L": rng.random((n, 3), np.float32),
            "range_m": rng.random(n, np.float32),
            "intensity": rng.random(n, np.float32),
            "ring": rng.integers(0, 16, n, np.uint8),
            "time_offset_ns": rng.integers(-10_000_000, 0, n, np.int32),
            "segmentation": rng.integers(0, 256, n, np.uint8),
        },
    }


def bytes_of(arrays: Arrays) -> bytes:
    """Return the bytes of all arrays joined, as the bare socket sends them."""
    return b"".join(array.tobytes() for named in arrays.values() for array in named.values())


def differing(expected: Arrays, received: Arrays) -> int:
    """Return the number of arrays that differ or that only one side has."""
    a, b = (
        {(t, name): x for t, named in arrays.items() for name, x in named.items()} for arrays in (expected, received)
    )
    return sum(key not in a or key not in b or not np.array_equal(a[key], b[key]) for key in a.keys() | b.keys())


@dataclass
class TransferRates:
    """Seconds per frame of each block, over the link and over the bare socket."""

    payload_bytes: int
    link_s: list[float] = field(default_factory=list)
    bare_s: list[float] = field(default_factory=list)

    @property
    def relative_rate(self) -> float:
        """Median over pairs of consecutive blocks of the link's rate relative to the bare socket's."""
        return median(bare / link for link, bare in zip(self.link_s, self.bare_s, strict=True))


class Endpoints(NamedTuple):
    """Address of this process, prefix of the far process's command line if it is on another host, folder of keys."""

    bench_address: str = "127.0.0.1"
    far_command: Sequence[str] = ()
    keys: Path | None = None


@contextmanager
def open_transfer(endpoints: Endpoints, arrangement: Arrangement, *, scale: float = 1.0) -> Iterator[Transfer]:
    """Start a server and the far process and connect them. Raises ConfigError, HandshakeError or LinkClosed."""
    cameras = {f"front/{name}": topic_schema(ImageSample, name) for name in _CAMERA}
    facts = SessionFacts(cameras | {"lidar": topic_schema(PointCloudSample)}, "lockstep", _TICK_NS, 100.0)
    server = CompanionServer(
        CompanionSettings(f"tcp://{endpoints.bench_address}:*", arrangement, endpoints.keys), facts
    )
    server.open()
    peer: subprocess.Popen[bytes] | None = None
    try:
        with socket.create_server((endpoints.bench_address, 0)) as listening:
            listening.settimeout(LIMIT_S)
            address = f"{endpoints.bench_address}:{listening.getsockname()[1]}"
            keys = (
                [] if endpoints.keys is None else [str(endpoints.keys / "peer.key"), str(endpoints.keys / "bench.pub")]
            )
            command = [
                *endpoints.far_command,
                sys.executable,
                "-P",
                "-m",
                __name__,
                server.endpoint,
                address,
                str(scale),
                *keys,
            ]
            path = os.pathsep.join(filter(None, (str(_ROOT), str(CLIENT_PATH), os.environ.get("PYTHONPATH", ""))))
            peer = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path})
            server.wait_for_clients(1, LIMIT_S)
            bare, _ = listening.accept()
        with bare:
            bare.settimeout(LIMIT_S)
            bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            yield Transfer(server, bare, peer, scale)
    finally:
        server.close("over", "the measurement is over")
        if peer is not None:
            peer.kill()
            peer.wait()


class Transfer:
    """The link and the bare socket between two processes. The constructor compares the arrays of the first frames."""

    def __init__(
        self, server: CompanionServer, bare: socket.socket, peer: subprocess.Popen[bytes], scale: float
    ) -> None:
        self.peer = peer
        self.differing = 0  # arrays of the compared frames that did not arrive as they were sent
        self._server, self._bare = server, bare
        self._number = 0
        for seed in range(_COMPARED_FRAMES):
            self._samples = _samples(frame_arrays(seed, scale))
            self._exchange(1, 1, self._send_frame, self._receive_link)
        self._frame_bytes = bytes_of(frame_arrays(_COMPARED_FRAMES - 1, scale))

    def measure(self, *, in_flight: int, seconds: float, min_pairs: int = 3) -> TransferRates:
        """Measure blocks of both connections in turn for about `seconds`, with up to `in_flight` unanswered frames.

        Raises LinkClosed if the far process has ended.
        """
        link = self._send_frame, self._receive_link
        bare = (lambda: self._bare.sendall(self._frame_bytes)), self._receive_bare
        rates = TransferRates(len(self._frame_bytes))
        slowest_s = max(
            self._block(10, in_flight, *functions) for functions in (link, bare)
        )  # also warms up both processes
        # Many short blocks: other load on the machine affects only some of them, which the median ignores.
        per_block = max(2 * MAX_IN_FLIGHT, round(min(_BLOCK_S, seconds / (4 * min_pairs)) / slowest_s))
        end_s = time.monotonic() + seconds
        while len(rates.link_s) < min_pairs or time.monotonic() < end_s:
            rates.link_s.append(self._block(per_block, in_flight, *link))
            rates.bare_s.append(self._block(per_block, in_flight, *bare))
        return rates

    def _block(self, frames: int, in_flight: int, send: Callable[[], object], receive: Callable[[], int]) -> float:
        """Return the seconds per frame. A first frame that wakes the far process is not timed."""
        self._exchange(1, 1, send, receive)
        began_s = time.perf_counter()
        self._exchange(frames, in_flight, send, receive)
        return (time.perf_counter() - began_s) / frames

    @staticmethod
    def _exchange(frames: int, in_flight: int, send: Callable[[], object], receive: Callable[[], int]) -> None:
        sent = answered = 0
        while answered < frames:
            if sent < frames and sent - answered < in_flight:
                send()
                sent += 1
            else:
                answered += receive()

    def _send_frame(self) -> None:
        frame = CompanionFrame(self._number, self._number, self._number * _TICK_NS, self._samples)
        if not self._server.send(frame):
            raise LinkClosed("companion link", f"frame {self._number} was not sent: {self._server.lost}")
        self._number += 1

    def _receive_link(self) -> int:
        replies = self._server.poll(LIMIT_S)
        if not replies:
            raise LinkClosed("companion link", f"no answer within {LIMIT_S:g} s: {self._server.lost}")
        self.differing += sum(int((reply.report or {}).get("differing", 0)) for reply in replies)
        return len(replies)

    def _receive_bare(self) -> int:
        received = 0
        while received < _ANSWER_BYTES:
            data = self._bare.recv(_ANSWER_BYTES - received)
            if not data:
                raise LinkClosed("bare socket", "the far process has closed it")
            received += len(data)
        return 1


def _samples(arrays: Arrays) -> tuple[CompanionSample, ...]:
    return tuple(CompanionSample(topic, 1, 0, 0, _POSE, named) for topic, named in arrays.items())


def main(arguments: Sequence[str]) -> None:
    """Run the far process; `arguments` are those of the command line."""
    from hil_companion.link.client import Client

    address, socket_address, scale, *keys = arguments
    key, bench_key = (Path(file) for file in keys) if keys else (None, None)
    client = Client.connect(address, name="peer", credit=MAX_IN_FLIGHT, key=key, bench_key=bench_key, wait_s=LIMIT_S)
    host, _, port = socket_address.rpartition(":")
    with client, socket.create_connection((host, int(port)), LIMIT_S) as bare:
        bare.settimeout(None)
        bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        size = len(bytes_of(frame_arrays(0, float(scale))))
        threading.Thread(target=_answer_bare, args=(bare, bytearray(size)), daemon=True).start()
        for number in count():
            frame = client.receive()
            if frame is None:
                return
            report = None
            if number < _COMPARED_FRAMES:
                arrays = {sample.topic: sample.arrays for sample in frame.samples.values()}
                report = {"differing": differing(frame_arrays(number, float(scale)), arrays)}
            client.done(frame, report=report)


def _answer_bare(bare: socket.socket, buffer: bytearray) -> None:
    while True:
        filled = 0
        while filled < len(buffer):
            received = bare.recv_into(memoryview(buffer)[filled:])
            if received == 0:
                return
            filled += received
        bare.sendall(bytes(_ANSWER_BYTES))


if __name__ == "__main__":
    main(sys.argv[1:])
