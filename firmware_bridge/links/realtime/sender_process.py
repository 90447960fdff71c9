"""The process that writes prepared frames to a descriptor, each at its absolute deadline.

A program of its own, started by `sender.RealtimeSender`. It starts in a few milliseconds because it imports nothing but
the standard library. It shares no interpreter lock and no memory with the bench, and runs with a real-time priority
where the user may have one.

    wait until the deadline; write; report how late the write was

Frames leave in the order in which they were pushed: a deadline that lies before the previous one, or in the past, is
simply late. A stale sample is worse than a missing one. The process drops a frame that is more than `stale_ns` late
before its turn comes (the process itself was held up), rather than send it in a burst with the next ones. On a full
line it waits until one period after the deadline, then drops the frame. Neither applies to frames pushed with
`keep` (commands), and a frame that was partly written is always finished. A line that takes nothing for
`stall_limit_ns`, fails or hangs up ends the sending.
"""

from __future__ import annotations

import errno
import gc
import os
import select
import socket
import struct
import sys
import time
from contextlib import suppress
from typing import NoReturn

PRIORITY = 80  # above the kernel's interrupt threads (50)
FRAME = struct.Struct("<qiB")  # deadline, size, keep; the frame's bytes follow
REPORT = struct.Struct("<Bqq")  # one of the kinds below and its two numbers
READY, SENT, SENT_KEPT, DROPPED, STALLED, FAILED = range(6)
MEMORY, SLACK, ISOLATED = 1, 2, 4  # granted, in the second number of READY; the first is the priority
_NEAR_NS = 3_000_000  # below this a deadline is slept for exactly; the unit of poll is a millisecond
_WRITABLE_NS = 10_000_000  # longest wait on a full line before the process checks whether to stop
_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL


def _request_priority() -> int:
    """Request SCHED_FIFO at 80 or the highest priority that the user may have.

    Returns the priority granted, or minus the errno of the refusal.
    """
    if not hasattr(os, "sched_setscheduler"):
        return -errno.ENOSYS
    import resource

    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    for priority in (PRIORITY, min(allowed, PRIORITY)):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            return priority
        except OSError as error:
            refusal = error.errno or errno.EPERM
    return -(errno.EPERM if refusal == errno.EINVAL else refusal)


def lock_memory(*, on_fault: bool = False) -> bool:
    """Lock the memory of this process, so that no sample waits for the disk. Return True if it is locked.

    `on_fault` locks a page when it is first used, for a process with much memory that it never touches.
    """
    import ctypes

    libc = ctypes.CDLL(None)
    return hasattr(libc, "mlockall") and libc.mlockall(1 | 2 | (4 if on_fault else 0)) == 0  # CURRENT, FUTURE, ONFAULT


def set_timer_slack(slack_ns: int) -> bool:
    """Set the timer slack of this thread, which adds 50 us to every sleep; 0 is the default. Return True if it is."""
    if sys.platform != "linux":
        return False
    import ctypes

    return ctypes.CDLL(None).prctl(29, slack_ns, 0, 0, 0) == 0  # PR_SET_TIMERSLACK


def isolated_processors() -> set[int]:
    """Return the processors on which the kernel runs nothing by itself (`isolcpus=` on its command line)."""
    try:
        with open("/sys/devices/system/cpu/isolated", encoding="ascii") as file:
            ranges = [part.partition("-") for part in file.read().strip().split(",") if part]
        return {cpu for first, _, last in ranges for cpu in range(int(first), int(last or first) + 1)}
    except (OSError, ValueError):
        return set()


def _take_isolated_processor() -> bool:
    """Run on the last isolated processor. Return False if there is none."""
    isolated = isolated_processors()
    if not isolated or not hasattr(os, "sched_setaffinity"):
        return False
    try:
        os.sched_setaffinity(0, {max(isolated)})
    except OSError:
        return False
    return True


class _Process:
    """The loop of the process: one frame at a time."""

    def __init__(self, fd: int, control_fd: int, period_ns: int, stale_ns: int, stall_limit_ns: int) -> None:
        self._fd, self._period_ns, self._stale_ns, self._stall_limit_ns = fd, period_ns, stale_ns, stall_limit_ns
        os.set_blocking(fd, False)
        self._control = socket.socket(fileno=control_fd)
        self._bench_left = select.poll()
        self._bench_left.register(control_fd, getattr(select, "POLLRDHUP", 0))
        self._hang_up, self._writable = select.poll(), select.poll()
        self._hang_up.register(fd, 0)
        self._writable.register(fd, select.POLLOUT)
        self._blocked_since_ns = 0  # 0: the last write succeeded

    def run(self) -> None:
        """Send frames until the bench closes its end or the line fails."""
        grants = lock_memory() * MEMORY | set_timer_slack(1) * SLACK | _take_isolated_processor() * ISOLATED
        self._report(READY, _request_priority(), grants)
        while True:
            deadline_ns, size, keep = FRAME.unpack(self._read(FRAME.size))
            frame = self._read(size)
            self._sleep_until(deadline_ns)
            self._send(deadline_ns, frame, keep=bool(keep))
            # A pseudo-terminal goes on taking bytes after its far end has closed. Checked after the write, which the
            # check would delay.
            if any(events & _GONE for _, events in self._hang_up.poll(0)):
                self._fail(errno.EIO, deadline_ns)

    def _read(self, size: int) -> bytes:
        data = self._control.recv(size, socket.MSG_WAITALL)
        if len(data) < size:
            sys.exit()
        return data

    def _report(self, kind: int, first: int, second: int) -> None:
        self._control.sendall(REPORT.pack(kind, first, second))

    def _fail(self, code: int, deadline_ns: int) -> NoReturn:
        self._report(FAILED, code, deadline_ns)
        sys.exit()

    def _sleep_until(self, deadline_ns: int) -> None:
        while True:
            left_ns = deadline_ns - time.monotonic_ns()
            if self._bench_left.poll(max(left_ns - _NEAR_NS, 0) // 1_000_000):
                sys.exit()
            if left_ns <= 0:
                return
            if left_ns <= _NEAR_NS + 1_000_000:
                time.sleep(left_ns * 1e-9)

    def _send(self, deadline_ns: int, frame: bytes, *, keep: bool) -> None:
        now_ns = time.monotonic_ns()
        if self._stale_ns and not keep and now_ns - deadline_ns > self._stale_ns:
            self._report(DROPPED, 0, 0)
            return
        give_up_ns = max(deadline_ns, now_ns) + self._period_ns
        left, waited = memoryview(frame), False
        while True:
            try:
                taken = os.write(self._fd, left)
                self._blocked_since_ns = 0
                left = left[taken:]
                if not left:
                    break
            except BlockingIOError:
                if not waited:
                    self._report(STALLED, 0, 0)
                waited = True
                self._blocked_since_ns = self._blocked_since_ns or now_ns
                if now_ns - self._blocked_since_ns >= self._stall_limit_ns:
                    self._fail(errno.ETIMEDOUT, deadline_ns)
                may_drop = len(left) == len(frame) and not keep
                if may_drop and now_ns >= give_up_ns:
                    self._report(DROPPED, 0, 0)
                    return
                wait_ns = min(_WRITABLE_NS, give_up_ns - now_ns) if may_drop else _WRITABLE_NS
                # Milliseconds, rounded up: a short wait must not become a busy loop.
                if any(events & _GONE for _, events in self._writable.poll(-(-wait_ns // 1_000_000))):
                    self._fail(errno.EIO, deadline_ns)
                if self._bench_left.poll(0):
                    sys.exit()
            except OSError as error:
                self._fail(error.errno or errno.EIO, deadline_ns)
            now_ns = time.monotonic_ns()
        # `now_ns` was taken right before the write of the last byte: an autopilot has no sample before the whole frame.
        self._report(SENT_KEPT if keep else SENT, deadline_ns, now_ns)


if __name__ == "__main__":
    gc.disable()
    with suppress(ConnectionError):  # the bench has ended
        _Process(*(int(word) for word in sys.argv[1:])).run()
