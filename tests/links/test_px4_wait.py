"""The calls between PX4's answer and the next HIL_SENSOR: only those that this message needs."""

from __future__ import annotations

import shlex
import statistics
import sys
from pathlib import Path
from typing import Any

import pytest

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.links.autopilot_link import LinkCaps, TickSamples
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.transports.fd_stream import FdStream
from firmware_bridge.transports.loopback import LoopbackTransport
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.part import Part, RunContext
from signals.errors import LockstepLost
from tests.worlds import fake_px4_sitl
from tests.worlds.bench_process import free_instance
from tests.worlds.patience import PATIENT
from tests.worlds.resting_vehicle import BARO, IMU, MAG
from tests.worlds.scripted_autopilot import FakeAutopilot

TICK_NS = 4_000_000
CAPS = LinkCaps("fake", lockstep=True, deterministic=False, boot_sensors=0)
# Calls of Python's functions and of built-in ones from the arrival of an answer to the write, both included.
MOST_CALLS = 56
_StatusText = message_class("STATUSTEXT")


class Line(LoopbackTransport):
    """The simulator's connection; lists its reads that bring bytes, and its writes."""

    def __init__(self, log: list[str], **script: Any) -> None:
        super().__init__(FakeAutopilot(boot_sensors=0, **script))
        self._log = log

    def write(self, data: bytes) -> None:
        self._log.append("write")
        super().write(data)

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        if data:
            self._log.append("read")
        return data


class Ground:
    """The second connection, with one message at each read."""

    name = "ground"

    def __init__(self, log: list[str]) -> None:
        self._log, self._encoder, self.parser = log, FrameEncoder(1, 1), FrameParser()

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> list[Frame]:
        self._log.append("ground")
        text = _StatusText(6, f"{self._log.count('ground')}")
        return self.parser.feed(self._encoder.frame(text.MSGID, pack(text)))


def opened(log: list[str], *, alone: bool, **script: Any) -> LockstepLink:
    link = LockstepLink(Line(log, **script), CAPS, ground=Ground(log), timeouts=PATIENT)  # type: ignore[arg-type]
    link.open()
    link.busy_wait_ns = 1_000_000 if alone else 0
    log.clear()
    return link


def tick(link: LockstepLink, number: int) -> list[int]:
    """Fly one tick; return the ids of its messages."""
    link.send(number, number * TICK_NS, TickSamples(IMU, MAG, BARO), b"")
    link.wait(number, number * TICK_NS)
    return [frame.msgid for frame in link.take_frames()]


@pytest.mark.parametrize(
    ("alone", "order"), [(True, ["write", "ground", "read"]), (False, ["write", "read", "ground"])]
)
def test_datagrams_are_read_while_px4_computes_on_another_processor(alone: bool, order: list[str]) -> None:
    log: list[str] = []
    link = opened(log, alone=alone)
    for number in range(3):
        messages = tick(link, number)
        assert messages.count(MSGID["STATUSTEXT"]) == messages.count(MSGID["HIL_ACTUATOR_CONTROLS"]) == 1
    assert log == order * 3
    link.close()


def test_the_last_datagrams_of_an_autopilot_that_fails_are_all_taken() -> None:
    log: list[str] = []
    link = opened(log, alone=True, fault="wrong_time", at=2)
    tick(link, 0)
    link.send(1, TICK_NS, TickSamples(IMU, MAG, BARO), b"")
    with pytest.raises(LockstepLost):
        link.wait(1, TICK_NS)
    texts = [frame for frame in link.take_frames() if frame.msgid == MSGID["STATUSTEXT"]]
    assert len(texts) == 2  # one from before the answer, one from after it
    link.close()


class CountedCalls(Part):
    """Counts the calls between each answer and the next write, in the air, of a bench on a processor of its own."""

    name = "counted_calls"
    every_ticks = 250
    _from_tick, _to_tick = 2500, 3250

    def __init__(self) -> None:
        self.counts: list[int] = []
        self.counting = False
        self._calls = 0
        self._run: RunContext

    def begin(self, run: RunContext) -> None:
        self._run = run

    def after_tick(self, tick: int) -> None:
        if tick == self._from_tick:
            self._run.link.busy_wait_ns = 1_000_000
        self.counting = self._from_tick <= tick < self._to_tick

    def ended(self) -> bool:
        return self._run.scheduler.tick >= self._to_tick

    def count(self, frame: object, event: str, argument: object) -> None:
        self._calls += event in ("call", "c_call")

    def answered(self) -> None:
        self._calls = 0
        sys.setprofile(self.count if self.counting else None)

    def written(self) -> None:
        if sys.getprofile() is not None:
            sys.setprofile(None)
            self.counts.append(self._calls)


@pytest.fixture
def px4_build(tmp_path: Path) -> Path:
    """Return the program of the stand-in, in a build tree of PX4."""
    tree = tmp_path / "build"
    (tree / "etc/init.d-posix/airframes").mkdir(parents=True)
    (tree / "etc/init.d-posix/rcS").write_text("#!/bin/sh\n")
    (tree / "etc/init.d-posix/airframes/10016_none_iris").write_text("")
    binary = tree / "bin/px4"
    binary.parent.mkdir()
    binary.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {shlex.quote(fake_px4_sitl.__file__)} "$@"\n')
    binary.chmod(0o755)
    return binary


@pytest.mark.skipif(sys.platform == "win32", reason="PX4 SITL does not run there")
def test_few_calls_lie_between_the_answer_and_the_next_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, px4_build: Path
) -> None:
    counted = CountedCalls()
    read, write = FdStream._read_now, FdStream.write

    def counted_read(stream: FdStream) -> bytes:
        data = read(stream)
        counted.answered()
        return data

    def counted_write(stream: FdStream, data: bytes) -> None:
        write(stream, data)
        counted.written()

    monkeypatch.setattr(FdStream, "_read_now", counted_read)
    monkeypatch.setattr(FdStream, "write", counted_write)
    # On a processor of its own the bench records after the write; on a shared one, before it.
    settings = ["autopilot.share_processor=false", "record.report=false"]
    settings += [f"autopilot.binary='{px4_build}'", f"autopilot.instance={free_instance()}"]
    result = run_bench(load_bench(rig="px4_sitl", settings=settings), tmp_path / "out", quiet=True, more=[counted])
    assert result.run["error"] is None
    assert len(counted.counts) > 500
    assert 30 < statistics.median(counted.counts) <= MOST_CALLS
