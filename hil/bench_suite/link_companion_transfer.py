"""How fast frames go over the companion link, beside the same bytes over a bare TCP socket between the same processes.

The link: from `CompanionServer.send` to the client's `done`, from the same arrays each time. The bare socket: all bytes
of the frame's arrays, put together beforehand, in one `sendall`, received into one buffer that is there already, and 20
bytes back; no header, no arrays, no checks. Both in turn, in short blocks, so that what else the machine does meets
both; each pair of them makes a ratio, and the median of those counts. Stop-and-wait: the next frame leaves when the
answer to the last is here. Streaming: four frames under way.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import IO, Any

from firmware_bridge.codecs.companion import topic_schema
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample, SessionFacts
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.companion.settings import Arrangement, CompanionSettings
from hil.bench_suite.link_companion_frame import (
    AHEAD,
    ANSWER_BYTES,
    Arrays,
    bytes_of,
    checksums,
    frame_arrays,
    size_of,
)
from hil.companion.started import CLIENT_PATH
from hil.signals.errors import LinkClosed
from hil.signals.samples import GpsSample, ImageSample, ImuSample, PointCloudSample, TruthState

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 20.0
_BLOCK_S = 0.02
_TICK_NS = 10_000_000
_FACTS = SessionFacts(
    {
        "front/rgb": topic_schema(ImageSample, "rgb"),
        "front/depth": topic_schema(ImageSample, "depth"),
        "front/segmentation": topic_schema(ImageSample, "segmentation"),
        "lidar": topic_schema(PointCloudSample),
        "imu": topic_schema(ImuSample),
        "gps": topic_schema(GpsSample),
        "truth": topic_schema(TruthState),
    },
    "lockstep",
    _TICK_NS,
    100.0,
)
_POSE = {"p_W": [1.0, 2.0, 3.0], "q_WB": [1.0, 0.0, 0.0, 0.0]}
_VALUES: dict[str, dict[str, Any]] = {
    "imu": {"accel_mps2": [[0.1, -0.2, 9.81]] * 3, "gyro_radps": [[0.01, 0.02, -0.03]] * 3},
    "gps": {"p_W": [[1.0, 2.0, 3.0]], "v_W": [[0.1, 0.2, 0.3]]},
    "truth": {**_POSE, "v_W": [0.1, 0.2, 0.3], "w_WB_B": [0.0, 0.0, 0.1]},
}


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


@dataclass(frozen=True)
class Wire:
    """Where the two ends are. `far`: what the far end's command line begins with, where it is another host."""

    near: str = "127.0.0.1"
    far: Sequence[str] = ()
    keys: Path | None = None


@contextmanager
def far_end(wire: Wire, arrangement: Arrangement, arrays: Arrays) -> Iterator[Transfer]:
    """A server here and a peer there, joined. HandshakeError, LinkClosed."""
    server = CompanionServer(CompanionSettings(f"tcp://{wire.near}:*", arrangement, wire.keys), _FACTS)
    server.open()
    peer: subprocess.Popen[str] | None = None
    try:
        with socket.create_server((wire.near, 0)) as listening:
            listening.settimeout(LIMIT_S)
            place = f"{wire.near}:{listening.getsockname()[1]}"
            keys = [] if wire.keys is None else [str(wire.keys / "peer.key"), str(wire.keys / "bench.pub")]
            command = [*wire.far, sys.executable, "-m", "hil.bench_suite.link_companion_peer"]
            path = os.pathsep.join(filter(None, (str(ROOT), str(CLIENT_PATH), os.environ.get("PYTHONPATH", ""))))
            peer = subprocess.Popen(
                [*command, server.endpoint, place, str(size_of(arrays)), *keys],
                env=os.environ | {"PYTHONPATH": path},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            server.wait_for_clients(1, LIMIT_S)
            bare, _ = listening.accept()
        with bare:
            bare.settimeout(LIMIT_S)
            bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            yield Transfer(server, bare, peer, arrays)
    finally:
        server.close("over", "the measurement is over")
        if peer is not None:
            _end(peer)


def _end(peer: subprocess.Popen[str]) -> None:
    assert peer.stdin is not None
    assert peer.stdout is not None
    try:
        peer.stdin.close()
        peer.wait(3.0)
    except (BrokenPipeError, subprocess.TimeoutExpired):
        peer.kill()
        peer.wait()
    peer.stdout.close()


class Transfer:
    """Both ways between one pair of processes."""

    def __init__(
        self, server: CompanionServer, bare: socket.socket, peer: subprocess.Popen[str], arrays: Arrays
    ) -> None:
        self._server, self._bare, self._peer = server, bare, peer
        self._samples = _samples(arrays)
        self._whole = bytes_of(arrays)
        self._number = 0

    def differing(self, frames: int = 3) -> int:
        """Arrays that do not arrive as they were sent, frames of other contents each."""
        out = self._peer.stdout
        assert out is not None
        wrong = 0
        for seed in range(1, frames + 1):
            arrays = frame_arrays(seed)
            self._tell("check", 1)
            self._link(1, 1, samples=_samples(arrays))
            wrong += _wrong(checksums(arrays), out)
        return wrong

    def measure(self, *, ahead: int, seconds: float, least_pairs: int = 3) -> Rates:
        """Blocks of both in turn for about so long."""
        rates = Rates(len(self._whole))
        # Short ones, many of them: what else the machine does falls on some, and the median passes over those.
        per_block = max(2 * AHEAD, round(min(_BLOCK_S, seconds / (4 * least_pairs)) / self._probe(ahead)))
        end_s = time.monotonic() + seconds
        while len(rates.link_s) < least_pairs or time.monotonic() < end_s:
            rates.link_s.append(self._block("link", self._link, per_block, ahead))
            rates.bare_s.append(self._block("bare", self._send_bare, per_block, ahead))
        return rates

    def _probe(self, ahead: int) -> float:
        """Seconds per frame, about; warms both ends up too."""
        link_s = self._block("link", self._link, 10, ahead)
        return max(link_s, self._block("bare", self._send_bare, 10, ahead))

    def _block(self, kind: str, send: Callable[..., None], count: int, ahead: int) -> float:
        """Seconds per frame. The first frame finds the far end asleep and is not timed."""
        self._tell(kind, count + 1)
        send(1, 1)
        began_s = time.perf_counter()
        send(count, ahead)
        return (time.perf_counter() - began_s) / count

    def _tell(self, kind: str, count: int) -> None:
        assert self._peer.stdin is not None
        self._peer.stdin.write(f"{kind} {count}\n")
        self._peer.stdin.flush()

    def _link(self, count: int, ahead: int, samples: tuple[CompanionSample, ...] | None = None) -> None:
        sent = answered = 0
        while answered < count:
            while sent < count and sent - answered < ahead:
                frame = CompanionFrame(
                    self._number,
                    self._number,
                    self._number * _TICK_NS,
                    samples if samples is not None else self._samples,
                )
                if not self._server.send(frame):
                    raise LinkClosed("companion link", f"frame {self._number} was not taken: {self._server.lost}")
                self._number += 1
                sent += 1
            replies = self._server.poll(LIMIT_S)
            if not replies:
                raise LinkClosed("companion link", f"no answer within {LIMIT_S:g} s: {self._server.lost}")
            answered += len(replies)

    def _send_bare(self, count: int, ahead: int) -> None:
        unanswered = 0
        for _ in range(count):
            if unanswered == ahead:
                self._hear()
                unanswered -= 1
            self._bare.sendall(self._whole)
            unanswered += 1
        for _ in range(unanswered):
            self._hear()

    def _hear(self) -> None:
        got = 0
        while got < ANSWER_BYTES:
            data = self._bare.recv(ANSWER_BYTES - got)
            if not data:
                raise LinkClosed("bare socket", "the far end is gone")
            got += len(data)


def _wrong(expected: dict[str, int], out: IO[str]) -> int:
    found = json.loads(out.readline() or "{}")
    return len(expected.keys() ^ found.keys()) + sum(found[k] != expected[k] for k in expected.keys() & found.keys())


def _samples(arrays: Arrays) -> tuple[CompanionSample, ...]:
    framed = [CompanionSample(topic, 1, 0, 0, _POSE, named) for topic, named in arrays.items()]
    return (*framed, *(CompanionSample(topic, 1, 0, 0, values) for topic, values in _VALUES.items()))
