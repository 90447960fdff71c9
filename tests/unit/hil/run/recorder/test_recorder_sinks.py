"""Digest, telemetry log, flight track and full disks."""

from __future__ import annotations

import errno
import hashlib
import io
import itertools
import os
import random
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_bridge.codecs.mavlink_frame import NO_FRAME, split_frames
from firmware_bridge.codecs.signing import Signer, SigningKey
from hil.run.recorder.digest import Digest
from hil.run.recorder.reading import read_messages
from hil.run.recorder.recorder import Recorder
from hil.run.recorder.tlog_sink import EPOCH_US
from hil.run.recorder.track import Track
from signals.errors import RecordingError
from signals.samples import TruthState
from tests.worlds.patience import PATIENCE_S
from tests.worlds.synthetic_flight import TICK_NS, Tick, fly, make_flight


@pytest.fixture(scope="module")
def flight() -> list[Tick]:
    return make_flight(300)


def digest_of(flight: list[Tick]) -> str:
    digest = Digest()
    for tick in flight:
        digest.truth(tick.truth)
        digest.sent(tick.sent)
        digest.received(tick.received)
    return digest.hexdigest()


def test_digest_does_not_depend_on_the_sinks(flight: list[Tick], tmp_path: Path) -> None:
    digests = set()
    for i, (mcap, tlog) in enumerate([(False, False), (True, False), (False, True), (True, True)]):
        recorder = Recorder(tmp_path / str(i), mcap=mcap, tlog=tlog, tick_ns=TICK_NS)
        fly(recorder, flight)
        recorder.close("PASS")
        digests.add(recorder.digest)
    assert digests == {digest_of(flight)}
    assert not (tmp_path / "0").exists()


def test_digest_is_described(flight: list[Tick]) -> None:
    oracle = hashlib.blake2b(digest_size=32)

    def item(tag: bytes, data: bytes) -> None:
        oracle.update(tag + struct.pack("<I", len(data)) + data)

    for tick in flight[:20]:
        t = tick.truth
        doubles = [*t.p_WB, *t.q_WB, *t.v_WB_W, *t.w_WB_B, *t.a_WB_W, *t.alpha_WB_B]
        rotors = t.rotor_speed_radps
        item(
            b"T",
            struct.pack("<Qq", t.tick, t.t_ns)
            + struct.pack(f"<{len(doubles)}d", *doubles)
            + struct.pack(f"<I{len(rotors)}dB", len(rotors), *rotors, t.in_contact),
        )
        item(b"S", tick.sent)
        for frame in tick.received:
            item(b"R", frame.raw)
    assert digest_of(flight[:20]) == oracle.hexdigest()


def test_split_frames_keeps_every_byte(flight: list[Tick]) -> None:
    from pymavlink.dialects.v10 import common as common_v1

    v1 = common_v1.MAVLink(None, srcSystem=9, srcComponent=9)
    heartbeat_v1 = v1.heartbeat_encode(6, 8, 0, 0, 4).pack(v1)
    assert split_frames(flight[25].sent)[0][0] == 0
    assert [m for m, _ in split_frames(flight[25].sent)] == [0, 107]
    assert split_frames(heartbeat_v1 + flight[1].sent) == [(0, heartbeat_v1), (107, flight[1].sent)]
    signed = Signer(SigningKey(bytes(32)), link_id=1).sign(flight[1].sent)
    assert split_frames(signed) == [(107, signed)]
    rng = random.Random(1)
    for _ in range(200):
        data = bytearray(flight[25].sent + heartbeat_v1 + flight[1].sent)
        for _ in range(rng.randrange(4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        del data[rng.randrange(len(data)) :]
        pieces = split_frames(bytes(data))
        assert b"".join(raw for _, raw in pieces) == data
        ids = [m for m, _ in pieces]
        assert (NO_FRAME, NO_FRAME) not in itertools.pairwise(ids)


def test_telemetry_log_is_read_by_pymavlink(flight: list[Tick], tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=False, tlog=True, tick_ns=TICK_NS)
    fly(recorder, flight)
    recorder.sent(300, 300 * TICK_NS, b"no frame")  # the format has no place for it
    recorder.close("PASS")
    expected = []
    for tick in flight:
        frames = [raw for _, raw in split_frames(tick.sent)] + [f.raw for f in tick.received]
        expected += [(tick.t_ns, raw) for raw in frames]
    from pymavlink import mavutil

    log = mavutil.mavlogfile(str(tmp_path / "flight.tlog"))
    found = []
    while (message := log.recv_msg()) is not None:
        assert message.get_type() != "BAD_DATA"
        found.append((round((message._timestamp * 1e6 - EPOCH_US)) * 1000, bytes(message.get_msgbuf())))
    log.close()
    assert len(found) == len(expected)
    assert [raw for _, raw in found] == [raw for _, raw in expected]
    # pymavlink keeps the time as a double of seconds: good to a microsecond this far from 1970
    assert max(abs(a - b) for (a, _), (b, _) in zip(found, expected, strict=True)) <= 1000


class FillingDisk(io.BytesIO):
    """Accepts `free_bytes` bytes, including a part of the last write, then reports a full disk."""

    def __init__(self, free_bytes: int) -> None:
        super().__init__()
        self.free_bytes = free_bytes

    def write(self, data) -> int:  # type: ignore[override]
        left = self.free_bytes - self.tell()
        if left <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(bytes(data[:left]))

    def close(self) -> None:  # keep the content for the test
        self.done = True


@pytest.mark.parametrize("free_bytes", [3_000, 250_000, 450_000])
def test_full_disk_is_one_error_and_leaves_a_readable_file(tmp_path: Path, free_bytes: int) -> None:
    disks = {}

    def open_file(path: Path) -> FillingDisk:
        disks[path.name] = FillingDisk(free_bytes if path.name == "run.mcap" else 10**9)
        return disks[path.name]

    flight = make_flight(800)
    errors = []
    recorder = Recorder(tmp_path, mcap=True, tlog=True, tick_ns=TICK_NS, open_file=open_file)
    for tick in flight:
        try:
            fly(recorder, [tick])
        except RecordingError as error:
            errors.append(error)
    recorder.close("ERROR")
    assert len(errors) == 1
    text = str(errors[0])
    assert "run.mcap" in text
    assert "No space left" in text
    tick_named = int(text.split("at tick ")[1].split()[0])
    assert tick_named in (249, 499, 749)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(disks["run.mcap"].getvalue())
    ticks = [m.sequence for m in read_messages(copy) if m.topic == "/truth/pose"]
    assert ticks == list(range(tick_named - 249))
    assert len(disks["flight.tlog"].getvalue()) > 800 * 100  # the other file is still written
    expected = Digest()
    for tick in flight:
        expected.truth(tick.truth)
        if tick.tick != tick_named + 1:  # the error skipped the other calls of this tick
            expected.sent(tick.sent)
            expected.received(tick.received)
    assert recorder.digest == expected.hexdigest()


def test_disk_full_from_the_start_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"run\.mcap: writing failed at tick 0 .*record\.mcap=false"):
        Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS, open_file=lambda _: FillingDisk(50))


def test_full_disk_at_the_very_end_is_raised_by_close_once(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=False, tlog=True, tick_ns=TICK_NS, open_file=lambda _: FillingDisk(100))
    fly(recorder, make_flight(20))
    with pytest.raises(RecordingError, match=r"flight\.tlog: writing failed at tick 19 .*record\.tlog=false"):
        recorder.close("PASS")
    recorder.close("PASS")


def test_unwritable_directory_is_named(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").mkdir()
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot be created"):
        Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)


def test_killed_process_leaves_both_files_readable(tmp_path: Path) -> None:
    code = (
        "import sys, os, signal, pathlib\n"
        "from hil.run.recorder.recorder import Recorder\n"
        "from tests.worlds.synthetic_flight import TICK_NS, fly, make_flight\n"
        "r = Recorder(pathlib.Path(sys.argv[1]), mcap=True, tlog=True, tick_ns=TICK_NS)\n"
        "fly(r, make_flight(600))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(__file__).parents[5]
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], cwd=root, timeout=PATIENCE_S)
    assert done.returncode == -signal.SIGKILL
    poses = [m for m in read_messages(tmp_path / "run.mcap") if m.topic == "/truth/pose"]
    assert len(poses) == 500
    from pymavlink import mavutil

    log = mavutil.mavlogfile(str(tmp_path / "flight.tlog"))
    count = 0
    while log.recv_msg() is not None:
        count += 1
    log.close()
    assert count == sum(len(split_frames(t.sent)) + len(t.received) for t in make_flight(600)[:500])


def test_track_is_thinned_and_bounded() -> None:
    track = Track(TICK_NS, limit=100)
    zero = (0.0, 0.0, 0.0)
    for k in range(5000):
        p = (k * 0.5, -k * 0.25, 1.0)
        truth = TruthState(
            k, k * TICK_NS, p, (1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0), zero, zero, zero, (4.0, 5.0), k < 10
        )
        track.truth(truth)
    arrays = track.arrays()
    assert 50 <= len(arrays.t_s) <= 100
    spacing = np.diff(arrays.t_s)
    assert spacing.min() == pytest.approx(spacing.max())
    assert spacing.min() >= 0.04
    assert arrays.t_s[-1] > 0.97 * 4999 * 0.004
    np.testing.assert_allclose(arrays.p_WB[:, 0], arrays.t_s / 0.004 * 0.5)
    assert arrays.rotor_speed_radps.shape == (len(arrays.t_s), 2)
    assert tuple(arrays.v_WB_W[0]) == (1.0, 2.0, 3.0)
    assert arrays.in_contact[0]
    assert not arrays.in_contact[-1]
