"""The serial line of the mock's process: waiting, reading, writing.

In lockstep the process only answers. In HITL it also sends at its own times, and never waits for a reader: like a
UART with a full buffer it drops what does not fit.
"""

from __future__ import annotations

import os
import select
import time

from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.hitl import BoardClock

_READ_SIZE = 65536
_PARENT_CHECK_S = 1.0  # period of the check for the parent process; in lockstep only while the line is silent
_HANG_UP = select.POLLHUP | select.POLLERR | select.POLLNVAL
_BUFFER_SIZE = 16384  # bytes that may wait for a slow reader, about 0.5 s of HITL


def serve(autopilot: MockPixhawk, fd: int) -> None:
    """Run `autopilot` on `fd` until the other side hangs up or the parent ends. Raises only `faults.Died`."""
    parent = os.getppid()
    try:
        if autopilot.clock is None:
            _answer(autopilot, fd, parent)
        else:
            _run_free(autopilot, autopilot.clock, fd, parent)
    except OSError:
        # EIO: the other end of the line was closed.
        return


def _answer(autopilot: MockPixhawk, fd: int, parent: int) -> None:
    os.set_blocking(fd, True)
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    wait, read, feed = poll.poll, os.read, autopilot.feed
    _write(fd, autopilot.boot())
    while True:
        events = wait(int(_PARENT_CHECK_S * 1000))
        if not events:
            if os.getppid() != parent:
                return
            continue
        if events[0][1] & _HANG_UP:
            return
        data = read(fd, _READ_SIZE)
        if not data:
            return
        out = feed(data)
        if out:
            _write(fd, out)


def _write(fd: int, data: bytes) -> None:
    written = os.write(fd, data)
    while written < len(data):
        written += os.write(fd, data[written:])


def _run_free(autopilot: MockPixhawk, clock: BoardClock, fd: int, parent: int) -> None:
    os.set_blocking(fd, False)
    buffer = SendBuffer(fd)
    buffer.write(autopilot.boot())
    parent_check_s = time.monotonic()
    while True:
        due_us = autopilot.next_due_us
        wait_s = _PARENT_CHECK_S if due_us is None else min(clock.until_s(due_us), _PARENT_CHECK_S)
        readable, _, _ = select.select([fd], [fd] if buffer.pending else [], [], wait_s)
        data = b""
        if readable:
            data = os.read(fd, _READ_SIZE)
            if not data:
                return
        buffer.write(autopilot.feed(data))
        now_s = time.monotonic()
        if now_s - parent_check_s >= _PARENT_CHECK_S:
            parent_check_s = now_s
            if os.getppid() != parent:
                return


class SendBuffer:
    """Buffer in front of a non-blocking descriptor. A write that does not fit is dropped whole."""

    def __init__(self, fd: int, size: int = _BUFFER_SIZE) -> None:
        self._fd, self._size = fd, size
        self.pending = b""
        self.dropped = 0  # bytes

    def write(self, data: bytes) -> None:
        """Append `data` if it fits, and write as much as the descriptor takes."""
        if len(self.pending) + len(data) > self._size:
            self.dropped += len(data)
        else:
            self.pending += data
        if not self.pending:
            return
        try:
            sent = os.write(self._fd, self.pending)
        except BlockingIOError:
            return
        self.pending = self.pending[sent:]
