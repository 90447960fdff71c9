"""The real-time sender: every byte once and in order, named ends, counts that add up. Never how fast."""

from __future__ import annotations

import errno
import os
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware_bridge._native import RealtimeSender
from firmware_bridge.links.paced_line import sending_failure

PERIOD_NS = 4_000_000
FAR_FUTURE_NS = 3_600 * 10**9
PATIENCE_S = 60.0  # of a loaded machine; nothing waits this long on an idle one


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


def frame(k: int, size: int = 64) -> bytes:
    return k.to_bytes(4, "little") + bytes((k + i) & 0xFF for i in range(size - 4))


class Line:
    """Two connected sockets and a reader that keeps all that came."""

    def __init__(self) -> None:
        self.near, self.far = socket.socketpair()
        self.got = bytearray()
        self._reader: threading.Thread | None = None

    def read_in_background(self) -> None:
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while data := self.far.recv(65536):
            self.got += data

    def close(self) -> None:
        self.near.close()
        if self._reader is not None:
            self._reader.join(PATIENCE_S)
        self.far.close()


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


@pytest.fixture
def sender(line: Line) -> Iterator[RealtimeSender]:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS)
    yield sender
    sender.stop()
    assert sender.sent + sender.dropped + sender.pending == sender.pushed


def test_frames_leave_in_order_whole_once_and_never_early(line: Line, sender: RealtimeSender) -> None:
    start = time.monotonic_ns() + 5_000_000
    for k in range(50):
        assert sender.push(start + k * 1_000_000, frame(k))
    got = b""
    line.far.settimeout(PATIENCE_S)
    while len(got) < 50 * 64:
        got += line.far.recv(65536)
        # Frame k is not there before its deadline.
        assert time.monotonic_ns() >= start + (len(got) // 64 - 1) * 1_000_000
    assert got == b"".join(frame(k) for k in range(50))
    until(lambda: sender.sent == 50)
    until(lambda: sender.pending == 0)
    assert (sender.pushed, sender.dropped, sender.refused) == (50, 0, 0)
    assert len(sender.take_lateness()) == 50
    assert sender.take_lateness() == []


def test_how_late_each_frame_left_is_told_in_order_without_those_left_out(line: Line) -> None:
    hour = 3_600 * 10**9
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, slots=2, stale_ns=5 * hour)
    late: list[int] = []
    now = time.monotonic_ns()
    for k in (1, 2, 9, 3, 4):
        until(lambda k=k: sender.push(now - k * hour, frame(k)))  # type: ignore[misc]
        late += sender.take_lateness()
    until(lambda: sender.pending == 0)
    late += sender.take_lateness()
    sender.stop()
    assert [lateness_ns // hour for lateness_ns in late] == [1, 2, 3, 4]
    assert (sender.sent, sender.dropped) == (4, 1)


def test_stale_frames_are_left_out_unless_they_are_to_be_kept(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, stale_ns=1800 * 10**9)
    now = time.monotonic_ns()
    assert sender.push(now, frame(0))
    assert sender.push(now - 3600 * 10**9, frame(1))
    assert sender.push(now - 3600 * 10**9, frame(2), keep=True)
    assert sender.push(now - 900 * 10**9, frame(3))
    until(lambda: sender.pending == 0)
    sender.stop()
    assert line.far.recv(65536) == frame(0) + frame(2) + frame(3)
    assert (sender.sent, sender.dropped, sender.pushed) == (3, 1, 4)


def test_the_longest_gap_is_between_samples_whatever_commands_lie_between(line: Line, sender: RealtimeSender) -> None:
    start = time.monotonic_ns()
    sender.push(start, frame(0))
    sender.push(start + 20_000_000, frame(1), keep=True)
    sender.push(start + 40_000_000, frame(2))
    until(lambda: sender.sent == 3)
    until(lambda: sender.pending == 0)
    # The first may be late, the last never early.
    assert sender.longest_gap_ns >= 40_000_000 - max(sender.take_lateness())


def test_on_a_full_line_a_kept_frame_waits_for_room(line: Line) -> None:
    line.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    sender = RealtimeSender(line.near.fileno(), period_ns=1_000_000, slots=512)
    until(lambda: sender.push(0, frame(sender.pushed, 2000)) and sender.dropped)
    kept = sender.pushed
    assert sender.push(0, frame(kept, 2000), keep=True)
    sender.push(0, frame(kept + 1, 2000))
    until(lambda: sender.pending == 2)
    dropped = sender.dropped
    time.sleep(0.02)  # many periods
    assert sender.pending == 2
    line.read_in_background()
    until(lambda: sender.pending == 0)
    sender.stop()
    line.close()
    assert frame(kept, 2000) in bytes(line.got)
    assert len(line.got) == 2000 * sender.sent
    assert sender.dropped <= dropped + 1


def test_a_full_ring_refuses_and_takes_again_when_there_is_room(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, slots=3)
    later = time.monotonic_ns() + FAR_FUTURE_NS
    assert [sender.push(later, frame(k)) for k in range(5)] == [True, True, True, False, False]
    assert (sender.pushed, sender.refused, sender.pending) == (3, 2, 3)
    sender.stop()
    assert (sender.sent, sender.pending, sender.error) == (0, 3, None)
    assert not sender.push(0, frame(9)), "a stopped sender takes nothing"

    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, slots=1)
    for k in range(20):
        until(lambda k=k: sender.push(0, frame(k)))  # type: ignore[misc]
    until(lambda: sender.sent == 20)
    sender.stop()
    assert line.far.recv(65536) == b"".join(frame(k) for k in range(20))


def test_stop_with_frames_in_line_ends_at_once_and_sends_none(line: Line, sender: RealtimeSender) -> None:
    assert sender.push(time.monotonic_ns() + FAR_FUTURE_NS, frame(0))
    done = threading.Thread(target=sender.stop)
    done.start()
    done.join(PATIENCE_S)
    assert not done.is_alive(), "an hour's sleep was not interrupted"
    sender.stop()
    line.far.setblocking(False)
    with pytest.raises(BlockingIOError):
        line.far.recv(1)


def test_a_sender_dropped_without_stop_lets_go_of_the_descriptor(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS)
    line.near.close()
    assert sender.push(0, frame(0)), "it has its own duplicate"
    line.far.settimeout(PATIENCE_S)
    assert line.far.recv(64, socket.MSG_WAITALL) == frame(0)
    del sender
    assert line.far.recv(1) == b"", "the last descriptor is closed"


def test_a_full_line_drops_stale_frames_but_never_part_of_one(line: Line) -> None:
    line.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, slots=512)
    until(lambda: sender.push(0, frame(sender.pushed, 2000)) and sender.dropped >= 3)
    assert sender.stalled >= sender.dropped
    line.read_in_background()
    before = sender.sent
    assert sender.push(0, frame(10_000, 2000))
    until(lambda: sender.pending == 0)
    assert sender.sent > before
    sender.stop()
    line.close()
    got = bytes(line.got)
    assert len(got) == sender.sent * 2000
    numbers = [int.from_bytes(got[i : i + 4], "little") for i in range(0, len(got), 2000)]
    assert numbers == sorted(set(numbers))
    assert got == b"".join(frame(k, 2000) for k in numbers)


def test_a_frame_larger_than_the_line_is_finished_however_long_that_takes() -> None:
    read_fd, write_fd = os.pipe()
    size = 300_000  # a pipe takes 64 KiB
    sender = RealtimeSender(write_fd, period_ns=1_000_000, slots=2, slot_bytes=size)
    os.close(write_fd)
    assert sender.push(0, frame(0, size))
    until(lambda: sender.stalled)
    time.sleep(0.05)  # many periods
    assert (sender.sent, sender.dropped, sender.pending) == (0, 0, 1)
    got = bytearray()
    while len(got) < size:
        got += os.read(read_fd, 10_000)
    assert got == frame(0, size)
    until(lambda: sender.sent == 1)
    sender.stop()
    assert os.read(read_fd, 1) == b""
    os.close(read_fd)


def test_a_line_that_takes_nothing_ends_the_sending(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS, stall_limit_ns=1)
    now = time.monotonic_ns()
    until(lambda: sender.error or not sender.push(now, frame(0, 4096)))
    until(lambda: sender.error)
    assert sender.error == (errno.ETIMEDOUT, now)
    failure = sending_failure(sender, "ttyX")
    assert failure is not None
    assert "takes no bytes" in str(failure)
    assert failure.port == "ttyX"
    assert not sender.push(now, frame(0))
    sender.stop()


def test_the_far_side_of_a_socket_gone_is_an_error_with_its_deadline(line: Line, sender: RealtimeSender) -> None:
    assert sending_failure(sender, "tcp") is None
    line.far.close()
    due = time.monotonic_ns() + 1_000_000
    assert sender.push(due, frame(0))
    until(lambda: sender.error)
    assert sender.error == (errno.EPIPE, due)
    assert "hung up" in str(sending_failure(sender, "tcp"))


@pytest.mark.parametrize("full", [False, True])
def test_a_pty_whose_far_end_closes_is_an_error(full: bool) -> None:
    near, far = os.openpty()
    tty.setraw(far)
    sender = RealtimeSender(near, period_ns=PERIOD_NS, slots=256)
    assert sender.push(0, b"hello")
    until(lambda: sender.sent == 1)
    assert os.read(far, 100) == b"hello"
    assert sender.error is None
    if full:
        until(lambda: sender.push(0, frame(1, 4096)) and sender.stalled)
    os.close(far)
    due = time.monotonic_ns()
    sender.push(due, b"anybody there?")
    until(lambda: sender.error)
    assert sender.error is not None
    assert sender.error[0] == errno.EIO
    sender.stop()
    os.close(near)


def test_a_descriptor_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    fd = os.open(path, os.O_RDONLY)
    sender = RealtimeSender(fd, period_ns=PERIOD_NS)
    sender.push(7, b"x")
    until(lambda: sender.error)
    assert sender.error == (errno.EBADF, 7)
    assert "cannot be written" in str(sending_failure(sender, "file"))
    sender.stop()
    os.close(fd)


def test_refusals(line: Line, sender: RealtimeSender) -> None:
    with pytest.raises(ValueError, match=r"5000 bytes .* slot holds 4096"):
        sender.push(0, bytes(5000))
    with pytest.raises(ValueError, match="nothing to send"):
        sender.push(0, b"")
    with pytest.raises(TypeError):
        sender.push(0.5, b"x")  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        sender.push(0, "text")  # type: ignore[arg-type]
    fd = line.near.fileno()
    for wrong in ({"period_ns": 0}, {"slots": 0}, {"slot_bytes": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            RealtimeSender(fd, **{"period_ns": PERIOD_NS, **wrong})  # type: ignore[arg-type]
    with pytest.raises(OSError, match="Bad file descriptor"):
        RealtimeSender(-1, period_ns=PERIOD_NS)


def test_it_says_what_scheduling_it_got(line: Line, sender: RealtimeSender) -> None:
    assert sender.scheduling.startswith(
        ("SCHED_FIFO ", "normal scheduling (no permission for SCHED_FIFO 80: to get it, ")
    )
    assert "memory" in sender.scheduling


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory in use is read from /proc")
def test_a_hundred_thousand_frames_take_no_memory_and_lose_no_byte(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=FAR_FUTURE_NS, slots=1024)
    total = 0

    def read() -> None:
        nonlocal total
        while data := line.far.recv(1 << 18):
            total += sum(data)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    data = frame(1, 200)
    first = 0
    for k in range(100_000):
        while not sender.push(0, data):
            select.select([], [], [], 0.001)
        if k == 10_000:
            first = _resident_bytes()
    until(lambda: sender.pending == 0)
    assert _resident_bytes() - first < 4_000_000, "90 000 frames of 200 bytes would be 18 MB"
    assert (sender.sent, sender.dropped, len(sender.take_lateness())) == (100_000, 0, 100_000)
    sender.stop()
    line.near.close()
    reader.join(PATIENCE_S)
    assert total == 100_000 * sum(data)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12 warns of any fork with threads
def test_a_forked_child_may_drop_its_copy(line: Line) -> None:
    sender = RealtimeSender(line.near.fileno(), period_ns=PERIOD_NS)
    child = os.fork()
    if child == 0:
        sender.stop()
        del sender
        os._exit(7)
    ended: list[int] = []
    until(lambda: ended.append(os.waitpid(child, os.WNOHANG)[0]) or ended[-1] == child)  # type: ignore[func-returns-value]
    assert sender.push(0, frame(0)), "the parent's sender lives on"
    until(lambda: sender.sent == 1)
    sender.stop()
