"""Frames of a megabyte between two hosts: by the companion link, and as bytes over a bare TCP socket beside it.

The second host is a network namespace on this machine, behind a pair of virtual Ethernet devices of 1 Gbit/s and, where
the kernel has netem, 0.2 ms each way. It needs root, `ip` and `tc`; the devices go with their namespace.

The link: from `CompanionServer.send` to the client's `done`, from the same arrays each time, with keys (CURVE). The
bare socket: all bytes of the frame's arrays, put together beforehand, in one `sendall`, received into one buffer that
is there already, and 20 bytes back; no header, no arrays, no checks, in clear. Both in turn between the same two
processes, in short blocks, so that what else the machine does meets both; each pair of blocks makes a ratio, and the
median of those counts. The error of the link is arrays that do not arrive as they were sent.

The far end is this module as a program: `ADDRESS HOST:PORT SCALE [KEY BENCH_KEY]`. It answers every frame of the link,
and every frame's length of bytes on the bare socket, until either ends; the answers to the first frames report how many
arrays differ from those that it makes itself.
"""

from __future__ import annotations

import os
import secrets
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
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
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.companion.started import CLIENT_PATH
from hil.signals.errors import LinkClosed, PortNotFound
from hil.signals.samples import ImageSample, PointCloudSample

Arrays = dict[str, dict[str, NDArray[Any]]]  # topic -> name -> array

LIMIT_S = 20.0
AHEAD = 4  # frames under way when they stream
_MODES = {"stop-and-wait": 1, "streaming": AHEAD}
_WIRED: tuple[Arrangement, ...] = ("one_port", "ports")
_OF_BARE = 0.8
_CHECKED = 3  # frames whose arrays are compared
_ANSWER_BYTES = 20
_BLOCK_S = 0.02
_TICK_NS = 10_000_000
_CAMERA = ("rgb", "depth", "segmentation")
_POSE = {"p_W": [1.0, 2.0, 3.0], "q_WB": [1.0, 0.0, 0.0, 0.0]}
_RATE_MBIT, _DELAY_MS = 1000, 0.2
_ROOT = Path(__file__).resolve().parents[2]


def measure_transfers(result: BenchmarkResult, folder: Path, say: Callable[[str], None], *, seconds: float) -> None:
    """`seconds` for each arrangement and way of sending. LinkClosed, HandshakeError where the link breaks."""
    with ExitStack() as stack:
        try:
            host = stack.enter_context(second_host())
        except PortNotFound as error:
            result.left_out.append(f"companion: transfers between two hosts ({error})")
            return
        if not host.delayed:
            result.left_out.append("companion: 0.2 ms of delay between the two hosts (this kernel has no netem)")
        make_keys(folder / "keys", ["peer"])
        for arrangement in _WIRED:
            say(f"transfers between two hosts, {arrangement}")
            with far_end(Wire(host.near, host.command, folder / "keys"), arrangement) as transfer:
                _measure(result, transfer, arrangement, seconds)


def _measure(result: BenchmarkResult, transfer: Transfer, arrangement: str, seconds: float) -> None:
    case, differ = "transfer, two hosts", transfer.differing
    for mode, ahead in _MODES.items():
        rates = transfer.measure(ahead=ahead, seconds=seconds)
        bare = f"bare socket beside {arrangement}"
        for method, wrong, blocks in ((arrangement, differ, rates.link_s), (bare, 0, rates.bare_s)):
            frame_s = median(blocks)
            details = {
                "frames_per_s": 1.0 / frame_s,
                "mb_per_s": rates.payload_bytes / frame_s / 1e6,
                "blocks": len(blocks),
                "load_average": os.getloadavg()[0],  # other work on the machine shows
            }
            result.rows.append(Row(f"{case}, {mode}", method, wrong, "arrays", frame_s, details))
        name = f"{case}, {arrangement}, {mode}: rate over the bare socket's"
        result.checks.append(Check(name, rates.of_bare, ">=", _OF_BARE, "1"))
    result.checks.append(Check(f"{case}, {arrangement}: arrays that differ", differ, "<=", 0, "arrays"))


def frame_arrays(seed: int, scale: float = 1.0) -> Arrays:
    """RGB, depth and segmentation of 320x240, LiDAR of 16x900, about 1 MB of noise; `scale` times the rows."""
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
    """All in one piece, as a bare socket sends them."""
    return b"".join(array.tobytes() for named in arrays.values() for array in named.values())


def differing(expected: Arrays, found: Arrays) -> int:
    """Arrays that only one has, or that are not the same."""
    a, b = ({(t, name): x for t, named in arrays.items() for name, x in named.items()} for arrays in (expected, found))
    return sum(key not in a or key not in b or not np.array_equal(a[key], b[key]) for key in a.keys() | b.keys())


@dataclass
class Rates:
    """What blocks of both came to. Times in seconds per frame, one a block."""

    payload_bytes: int
    link_s: list[float] = field(default_factory=list)
    bare_s: list[float] = field(default_factory=list)

    @property
    def of_bare(self) -> float:
        """The link's rate over the bare socket's: median over the pairs of blocks, which saw the same machine."""
        return median(bare / link for link, bare in zip(self.link_s, self.bare_s, strict=True))


class Wire(NamedTuple):
    """Where the two ends are. `far`: what the far end's command line begins with, where it is another host."""

    near: str = "127.0.0.1"
    far: Sequence[str] = ()
    keys: Path | None = None


@contextmanager
def far_end(wire: Wire, arrangement: Arrangement, *, scale: float = 1.0) -> Iterator[Transfer]:
    """A server here and a far end there, joined. ConfigError, HandshakeError, LinkClosed."""
    cameras = {f"front/{name}": topic_schema(ImageSample, name) for name in _CAMERA}
    facts = SessionFacts(cameras | {"lidar": topic_schema(PointCloudSample)}, "lockstep", _TICK_NS, 100.0)
    server = CompanionServer(CompanionSettings(f"tcp://{wire.near}:*", arrangement, wire.keys), facts)
    server.open()
    peer: subprocess.Popen[bytes] | None = None
    try:
        with socket.create_server((wire.near, 0)) as listening:
            listening.settimeout(LIMIT_S)
            place = f"{wire.near}:{listening.getsockname()[1]}"
            keys = [] if wire.keys is None else [str(wire.keys / "peer.key"), str(wire.keys / "bench.pub")]
            command = [*wire.far, sys.executable, "-m", __name__, server.endpoint, place, str(scale), *keys]
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
    """Both ways between one pair of processes."""

    def __init__(
        self, server: CompanionServer, bare: socket.socket, peer: subprocess.Popen[bytes], scale: float
    ) -> None:
        self.peer = peer
        self.differing = 0  # arrays that did not arrive as they were sent, in frames of other contents each
        self._server, self._bare = server, bare
        self._number = 0
        for seed in range(_CHECKED):
            self._samples = _samples(frame_arrays(seed, scale))
            self._pass(1, 1, self._send_frame, self._hear_link)
        self._whole = bytes_of(frame_arrays(_CHECKED - 1, scale))

    def measure(self, *, ahead: int, seconds: float, least_pairs: int = 3) -> Rates:
        """Blocks of both in turn for about so long; `ahead`: frames under way."""
        link = self._send_frame, self._hear_link
        bare = (lambda: self._bare.sendall(self._whole)), self._hear_bare
        rates = Rates(len(self._whole))
        slowest_s = max(self._block(10, ahead, *how) for how in (link, bare))  # warms both ends up too
        # Short ones, many of them: what else the machine does falls on some, and the median passes over those.
        per_block = max(2 * AHEAD, round(min(_BLOCK_S, seconds / (4 * least_pairs)) / slowest_s))
        end_s = time.monotonic() + seconds
        while len(rates.link_s) < least_pairs or time.monotonic() < end_s:
            rates.link_s.append(self._block(per_block, ahead, *link))
            rates.bare_s.append(self._block(per_block, ahead, *bare))
        return rates

    def _block(self, frames: int, ahead: int, send: Callable[[], object], hear: Callable[[], int]) -> float:
        """Seconds per frame. The first frame finds the far end asleep and is not timed."""
        self._pass(1, 1, send, hear)
        began_s = time.perf_counter()
        self._pass(frames, ahead, send, hear)
        return (time.perf_counter() - began_s) / frames

    @staticmethod
    def _pass(frames: int, ahead: int, send: Callable[[], object], hear: Callable[[], int]) -> None:
        sent = answered = 0
        while answered < frames:
            if sent < frames and sent - answered < ahead:
                send()
                sent += 1
            else:
                answered += hear()

    def _send_frame(self) -> None:
        frame = CompanionFrame(self._number, self._number, self._number * _TICK_NS, self._samples)
        if not self._server.send(frame):
            raise LinkClosed("companion link", f"frame {self._number} was not taken: {self._server.lost}")
        self._number += 1

    def _hear_link(self) -> int:
        replies = self._server.poll(LIMIT_S)
        if not replies:
            raise LinkClosed("companion link", f"no answer within {LIMIT_S:g} s: {self._server.lost}")
        self.differing += sum(int((reply.report or {}).get("differing", 0)) for reply in replies)
        return len(replies)

    def _hear_bare(self) -> int:
        got = 0
        while got < _ANSWER_BYTES:
            data = self._bare.recv(_ANSWER_BYTES - got)
            if not data:
                raise LinkClosed("bare socket", "the far end is gone")
            got += len(data)
        return 1


def _samples(arrays: Arrays) -> tuple[CompanionSample, ...]:
    return tuple(CompanionSample(topic, 1, 0, 0, _POSE, named) for topic, named in arrays.items())


class Host(NamedTuple):
    """`near`: this side's address on the wire between. `command`: begins a command line that runs over there."""

    near: str
    command: tuple[str, ...]
    delayed: bool  # by 0.2 ms each way; else the wire has its rate only


@contextmanager
def second_host() -> Iterator[Host]:
    """A network namespace, gone afterwards whatever failed. PortNotFound says what is missing to make one."""
    if os.geteuid() != 0:
        raise PortNotFound("second host", "only root may make network namespaces")
    name = f"hil-{secrets.token_hex(3)}"
    here, there, over = f"{name}-n", f"{name}-f", f"ip netns exec {name}"
    # Of 198.18.0.0/15, which RFC 2544 sets aside for measurements between network devices.
    block = f"198.18.{1 + secrets.randbelow(254)}"
    last = 4 * secrets.randbelow(60)
    try:
        _do(f"ip netns add {name}")
        _do(f"ip link add {here} type veth peer name {there}")
        _do(f"ip link set {there} netns {name}")
        for address, device, where in ((last + 1, here, ""), (last + 2, there, over)):
            _do(f"{where} ip address add {block}.{address}/30 dev {device}")
            _do(f"{where} ip link set {device} up")
        ends = ((here, ""), (there, over))
        delayed = True
        try:
            for device, where in ends:
                netem = f"netem delay {_DELAY_MS}ms rate {_RATE_MBIT}mbit limit 10000"
                _do(f"{where} tc qdisc replace dev {device} root {netem}")
        except PortNotFound:
            delayed = False
            for device, where in ends:
                # A burst of more than the greatest segment that the kernel hands over at once.
                tbf = f"tbf rate {_RATE_MBIT}mbit burst 128kb latency 50ms"
                _do(f"{where} tc qdisc replace dev {device} root {tbf}")
        yield Host(f"{block}.{last + 1}", tuple(over.split()), delayed)
    finally:
        for undo in (f"ip link delete {here}", f"ip netns delete {name}"):
            with suppress(PortNotFound):
                _do(undo)


def _do(command: str) -> None:
    try:
        done = subprocess.run(command.split(), capture_output=True, text=True, timeout=10.0, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PortNotFound("second host", f"{command}: {error}") from error
    if done.returncode != 0:
        raise PortNotFound("second host", f"{command}: {done.stderr.strip() or done.returncode}")


def main(arguments: Sequence[str]) -> None:
    """The far end."""
    from hil_companion.client import Client

    address, place, scale, *keys = arguments
    key, bench_key = (Path(file) for file in keys) if keys else (None, None)
    client = Client.connect(address, name="peer", credit=AHEAD, key=key, bench_key=bench_key, wait_s=LIMIT_S)
    host, _, port = place.rpartition(":")
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
            if number < _CHECKED:
                got = {sample.topic: sample.arrays for sample in frame.samples.values()}
                report = {"differing": differing(frame_arrays(number, float(scale)), got)}
            client.done(frame, report=report)


def _answer_bare(bare: socket.socket, room: bytearray) -> None:
    while True:
        at = 0
        while at < len(room):
            got = bare.recv_into(memoryview(room)[at:])
            if got == 0:
                return
            at += got
        bare.sendall(bytes(_ANSWER_BYTES))


if __name__ == "__main__":
    main(sys.argv[1:])
