"""The real-time sender: every byte once and in order, named errors, consistent counts. No timing is asserted."""

from __future__ import annotations

import errno
import io
import os
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware_bridge.links.realtime.sender import RealtimeSender, SendStats, denied
from firmware_bridge.links.realtime.sender_process import ISOLATED, MEMORY, SLACK, isolated_processors
from tests.worlds.patience import PATIENCE_S, until

PERIOD_NS = 4_000_000
HOUR_NS = 3_600 * 10**9


def frame(k: int, size: int = 64) -> bytes:
    return k.to_bytes(4, "little") + bytes((k + i) & 0xFF for i in range(size - 4))


class Line:
    """Two connected sockets and a reader that keeps all received bytes."""

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


class Sender(RealtimeSender):
    """A sender and its counts, which `wait` updates until a condition holds."""

    def __init__(self, fd: int, *, period_ns: int = PERIOD_NS, **settings: int) -> None:
        super().__init__(fd, SendStats(), period_ns=period_ns, **settings)

    def wait(self, condition: Callable[[SendStats], object]) -> None:
        def holds() -> object:
            self.collect()
            return condition(self.stats)

        until(holds)

    def counts(self) -> tuple[int, int, int]:
        """Return sent, dropped, pending."""
        self.collect()
        return self.stats.sent, self.stats.dropped, self.stats.pending


@pytest.fixture
def sender(line: Line) -> Iterator[Sender]:
    sender = Sender(line.near.fileno())
    yield sender
    sender.stop()
    assert sum(sender.counts()) == sender.stats.pushed


def test_frames_leave_in_order_whole_once_and_never_early(line: Line) -> None:
    sender = Sender(line.near.fileno(), max_pending=50)
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
    sender.stop()
    assert sender.counts() == (50, 0, 0)
    assert sender.stats.refused == 0
    assert sender.stats.lateness.count == 50
    assert sender.stats.scheduling.startswith(
        ("SCHED_FIFO ", "normal scheduling (no permission for SCHED_FIFO 80: to get it, ")
    )
    assert "memory" in sender.stats.scheduling


def test_stale_frames_are_left_out_unless_they_are_to_be_kept(line: Line) -> None:
    sender = Sender(line.near.fileno(), stale_ns=HOUR_NS // 2)
    now = time.monotonic_ns()
    assert sender.push(now, frame(0))
    assert sender.push(now - HOUR_NS, frame(1))
    assert sender.push(now - HOUR_NS, frame(2), keep=True)
    assert sender.push(now - HOUR_NS // 4, frame(3))
    sender.wait(lambda stats: not stats.pending)
    sender.stop()
    assert line.far.recv(65536) == frame(0) + frame(2) + frame(3)
    assert sender.counts() == (3, 1, 0)
    assert sender.stats.lateness.max_ns // HOUR_NS == 1


def test_the_longest_gap_is_between_samples_whatever_commands_lie_between(line: Line, sender: Sender) -> None:
    start = time.monotonic_ns()
    sender.push(start, frame(0))
    sender.push(start + 20_000_000, frame(1), keep=True)
    sender.push(start + 40_000_000, frame(2))
    sender.wait(lambda stats: stats.sent == 3)
    # The first may be late, the last never early.
    assert sender.stats.longest_gap_ns >= 40_000_000 - sender.stats.lateness.max_ns


def test_on_a_full_line_frames_are_left_out_but_never_part_of_one_and_commands_wait(line: Line) -> None:
    line.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    sender = Sender(line.near.fileno(), period_ns=1_000_000)

    def one_dropped() -> bool:
        sender.push(0, frame(sender.stats.pushed, 2000))
        return sender.stats.dropped > 0

    until(one_dropped)
    sender.wait(lambda stats: not stats.pending)
    kept = sender.stats.pushed
    assert sender.push(0, frame(kept, 2000), keep=True)
    sender.push(0, frame(kept + 1, 2000))
    time.sleep(0.02)  # many periods
    assert sender.counts()[2] == 2
    assert sender.stats.stalled >= sender.stats.dropped
    line.read_in_background()
    sender.wait(lambda stats: not stats.pending)
    sender.stop()
    line.close()
    got = bytes(line.got)
    assert len(got) == sender.stats.sent * 2000
    numbers = [int.from_bytes(got[i : i + 4], "little") for i in range(0, len(got), 2000)]
    assert numbers == sorted(set(numbers))
    assert kept in numbers
    assert got == b"".join(frame(k, 2000) for k in numbers)


def test_a_full_queue_refuses_frames_and_stop_ends_at_once_without_sending(line: Line) -> None:
    sender = Sender(line.near.fileno(), max_pending=3)
    later = time.monotonic_ns() + HOUR_NS
    assert [sender.push(later, frame(k)) for k in range(5)] == [True, True, True, False, False]
    assert (sender.stats.pushed, sender.stats.refused, sender.stats.pending) == (3, 2, 3)
    sender.stop()
    sender.stop()
    assert (sender.counts(), sender.error) == ((0, 0, 3), None)
    assert not sender.push(0, frame(9)), "a stopped sender takes nothing"
    line.far.setblocking(False)
    with pytest.raises(BlockingIOError):
        line.far.recv(1)


def test_a_frame_of_which_the_line_took_a_part_is_finished_however_long_that_takes(line: Line, sender: Sender) -> None:
    line.near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # the kernel makes 4608 of it, filled in two pieces
    before = bytes(1500)
    line.near.send(before)
    assert sender.push(0, frame(0, 4096))
    sender.wait(lambda stats: stats.stalled)
    time.sleep(0.05)  # many periods
    assert sender.counts() == (0, 0, 1)
    line.read_in_background()
    sender.wait(lambda stats: stats.sent == 1)
    sender.stop()
    line.close()
    assert line.got == before + frame(0, 4096)


def test_a_line_that_takes_nothing_ends_the_sending(line: Line) -> None:
    sender = Sender(line.near.fileno(), stall_limit_ns=1)
    now = time.monotonic_ns()
    until(lambda: not sender.push(now, frame(0, 4096)) and sender.error)
    assert sender.error == (errno.ETIMEDOUT, now)
    failure = sender.failure("ttyX")
    assert failure is not None
    assert "takes no bytes" in str(failure)
    assert failure.port == "ttyX"
    assert not sender.push(now, frame(0))
    sender.stop()


def test_the_far_side_of_a_socket_gone_is_an_error_with_its_deadline(line: Line, sender: Sender) -> None:
    assert sender.failure("tcp") is None
    line.far.close()
    due = time.monotonic_ns() + 1_000_000
    assert sender.push(due, frame(0))
    sender.wait(lambda _: sender.error)
    assert sender.error == (errno.EPIPE, due)
    assert "hung up" in str(sender.failure("tcp"))


@pytest.mark.parametrize("full", [False, True])
def test_a_pty_whose_far_end_closes_is_an_error(full: bool) -> None:
    near, far = os.openpty()
    tty.setraw(far)
    sender = Sender(near)
    assert sender.push(0, b"hello")
    sender.wait(lambda stats: stats.sent == 1)
    assert os.read(far, 100) == b"hello"
    assert sender.error is None
    if full:
        until(lambda: sender.push(0, frame(1, 4096)) and sender.stats.stalled)
    os.close(far)
    sender.push(time.monotonic_ns(), b"anybody there?")
    sender.wait(lambda _: sender.error)
    assert sender.error is not None
    assert sender.error[0] == errno.EIO
    sender.stop()
    os.close(near)


def test_a_descriptor_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    fd = os.open(path, os.O_RDONLY)
    sender = Sender(fd)
    sender.push(7, b"x")
    sender.wait(lambda _: sender.error)
    assert sender.error == (errno.EBADF, 7)
    assert "cannot be written" in str(sender.failure("file"))
    sender.stop()
    os.close(fd)
    with pytest.raises(OSError, match="Bad file descriptor"):
        Sender(-1)


def test_frames_of_no_size_or_too_large_are_refused(sender: Sender) -> None:
    for size in (0, 5000):
        with pytest.raises(ValueError, match=f"{size} bytes in one frame; 1 to 4096"):
            sender.push(0, bytes(size))


def test_a_killed_sender_process_is_an_error(line: Line, sender: Sender) -> None:
    sender._process.kill()
    sender.wait(lambda _: sender.error)
    assert sender.failure("ttyX") is not None


def test_what_was_not_granted_is_listed_with_its_remedy() -> None:
    assert denied(80, MEMORY | SLACK | ISOLATED) == ()
    nothing = denied(-1, 0)
    assert [text.split(" (")[0] for text in nothing] == [
        "real-time priority", "locked memory", "exact timers", "a processor of its own"
    ]  # fmt: skip
    assert "limits.conf" in nothing[0]
    assert denied(80, MEMORY | SLACK) == nothing[3:]


def test_isolated_processors_are_read_from_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    for text, processors in (("\n", set()), ("3\n", {3}), ("1-2,5\n", {1, 2, 5}), ("nonsense\n", set())):
        monkeypatch.setattr("builtins.open", lambda *_args, text=text, **_more: io.StringIO(text))
        assert isolated_processors() == processors
