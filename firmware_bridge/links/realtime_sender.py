"""Writes prepared frames to a descriptor, each at its absolute deadline, from a process of its own.

    bench      push(deadline, bytes) -> a socket pair ->
    process    sleep until the deadline; write; report how late the write was

A free-running autopilot stamps samples on arrival, so a late write is a wrong sample. The process shares no interpreter
lock and no memory with the bench, and has a real-time priority where the user may have one. First in, first out: a
deadline that lies before the one in front of it, or in the past, is simply late.

A stale sample is worse than a missing one. A frame that is more than `stale_ns` late before its turn comes (the process
itself was held up) is left out, rather than sent in a burst with those behind it. On a full line the process waits for
room until one period after the deadline, then leaves the frame out. Neither goes for frames pushed with `keep`
(commands), and a frame of which the line took a part is always finished. A line that takes nothing for
`stall_limit_ns`, or fails or hangs up, ends the sending: `error`.

This file is also the program of that process: it starts in a few milliseconds, for it imports nothing but the standard
library.
"""

from __future__ import annotations

import errno
import gc
import os
import select
import socket
import struct
import subprocess
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from firmware_bridge.links.paced_line import SendStats

LONGEST_FRAME = 4096
_PRIORITY = 80  # above the kernel's interrupt threads (50)
_FRAME = struct.Struct("<qiB")  # deadline, size, keep; the frame's bytes follow
_REPORT = struct.Struct("<Bqq")
_READY, _SENT, _SENT_KEPT, _DROPPED, _STALLED, _FAILED = range(6)
_SOCKET_BYTES = 256 * 1024  # more than the frames in line: a push never waits
_NEAR_NS = 3_000_000  # a deadline this near is slept for exactly; poll's own unit is a millisecond
_LOOK_NS = 10_000_000  # longest wait for room in the line without a look at whether to stop
_STOP_S = 10.0
_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL
_REMEDY = (
    "to get it, add `rtprio 90` and `memlock unlimited` for your user to /etc/security/limits.conf and log in again, "
    "or run `sudo setcap cap_sys_nice,cap_ipc_lock+ep` on the Python program"
)


class RealtimeSender:
    """The bench's end. It counts in `stats`, which may have counted for an earlier sender.

    Makes `fd` non-blocking and sends on the process's own copy of it until `stop`. OSError if `fd` is no descriptor.
    """

    def __init__(
        self,
        fd: int,
        stats: SendStats,
        *,
        period_ns: int,
        most_in_line: int = 16,
        stall_limit_ns: int = 5_000_000_000,
        stale_ns: int = 0,
    ) -> None:
        os.fstat(fd)
        self.stats = stats
        stats.pending = 0
        self.error: tuple[int, int] | None = None  # errno, and the deadline of the frame that met it [ns]
        self._most_in_line = most_in_line
        self._pid = os.getpid()
        self._stopped = False
        self._reports = b""
        self._last_sent_ns = 0
        self._control, far = socket.socketpair()
        self._control.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
        with far:
            arguments = [str(n) for n in (fd, far.fileno(), period_ns, stale_ns, stall_limit_ns)]
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", __file__, *arguments],
                pass_fds=(fd, far.fileno()),
                stdin=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is the bench's business
            )
        self._take(self._control.recv(_REPORT.size, socket.MSG_WAITALL))  # until it has said what scheduling it got
        self._control.setblocking(False)

    def push(self, deadline_ns: int, frame: bytes, *, keep: bool = False) -> bool:
        """Put a frame in line; never waits. False: too many are in line, or the sender stopped or failed.

        `keep`: send it however late (commands); others are left out once stale.
        """
        if not 0 < len(frame) <= LONGEST_FRAME:
            raise ValueError(f"{len(frame)} bytes in one frame; 1 to {LONGEST_FRAME} can be sent")
        self.collect()
        stats = self.stats
        if self._stopped or self.error is not None or stats.pending >= self._most_in_line:
            stats.refused += 1
            return False
        self._control.setblocking(True)  # there is room for it
        with suppress(OSError):  # it has ended: its last report says why
            self._control.sendall(_FRAME.pack(deadline_ns, len(frame), keep) + frame)
        self._control.setblocking(False)
        stats.pushed += 1
        stats.pending += 1
        return True

    def collect(self) -> None:
        """Bring `stats` and `error` up to date."""
        if self._stopped:
            return
        with suppress(BlockingIOError, ConnectionError):
            while data := self._control.recv(65536):
                self._take(data)
            if self.error is None and self._process.poll() is not None:
                self.error = (errno.ECHILD, self._last_sent_ns)  # somebody ended the process

    def _take(self, data: bytes) -> None:
        stats = self.stats
        data = self._reports + data
        whole = len(data) - len(data) % _REPORT.size
        self._reports = data[whole:]
        for kind, first, second in _REPORT.iter_unpack(data[:whole]):
            if kind in (_SENT, _SENT_KEPT):
                stats.count_lateness(max(second - first, 0))
                stats.sent += 1
                stats.pending -= 1
                if kind == _SENT:
                    if self._last_sent_ns:
                        stats.longest_gap_ns = max(stats.longest_gap_ns, second - self._last_sent_ns)
                    self._last_sent_ns = second
            elif kind == _DROPPED:
                stats.dropped += 1
                stats.pending -= 1
            elif kind == _STALLED:
                stats.stalled += 1
            elif kind == _FAILED:
                self.error = (first, second)
            else:
                stats.scheduling = _scheduling(first, memory_locked=bool(second))

    def stop(self) -> None:
        """End the process; frames whose deadline has not come stay unsent. May be called any number of times."""
        if self._stopped:
            return
        if os.getpid() == self._pid:  # in a forked child the process is not its own
            with suppress(OSError):
                self._control.shutdown(socket.SHUT_WR)
            try:
                self._process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self.collect()
        self._stopped = True
        self._control.close()

    def __del__(self) -> None:
        if hasattr(self, "_process"):
            self.stop()


def _scheduling(priority: int, *, memory_locked: bool) -> str:
    """What the process was granted, in words. `priority` below 0 is the errno of the refusal."""
    memory = "memory locked" if memory_locked else "memory not locked"
    if priority > 0:
        return f"SCHED_FIFO {priority}, {memory}"
    if -priority == errno.EPERM:
        return f"normal scheduling (no permission for SCHED_FIFO {_PRIORITY}: {_REMEDY}), {memory}"
    return f"normal scheduling (SCHED_FIFO {_PRIORITY} refused: {os.strerror(-priority)}), {memory}"


# ---- the process ------------------------------------------------------------------------------------------------


def _ask_for_priority() -> int:
    """SCHED_FIFO at 80 or the highest priority that the user may have: that priority, else minus the errno."""
    if not hasattr(os, "sched_setscheduler"):
        return -errno.ENOSYS
    import resource

    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    for priority in (_PRIORITY, min(allowed, _PRIORITY)):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            return priority
        except OSError as error:
            refusal = error.errno or errno.EPERM
    return -(errno.EPERM if refusal == errno.EINVAL else refusal)


def _ask_for_punctuality() -> bool:
    """No timer slack, whose 50 us would be added to every sleep; whether the memory is locked."""
    import ctypes

    libc = ctypes.CDLL(None)
    if sys.platform == "linux":
        libc.prctl(29, 1, 0, 0, 0)  # PR_SET_TIMERSLACK, ns
    return hasattr(libc, "mlockall") and libc.mlockall(1 | 2) == 0  # MCL_CURRENT, MCL_FUTURE


class _Process:
    """The far end: one frame at a time."""

    def __init__(self, fd: int, control_fd: int, period_ns: int, stale_ns: int, stall_limit_ns: int) -> None:
        self._fd, self._period_ns, self._stale_ns, self._stall_limit_ns = fd, period_ns, stale_ns, stall_limit_ns
        os.set_blocking(fd, False)
        self._control = socket.socket(fileno=control_fd)
        self._bench_left = select.poll()
        self._bench_left.register(control_fd, getattr(select, "POLLRDHUP", 0))
        self._hang_up, self._room = select.poll(), select.poll()
        self._hang_up.register(fd, 0)
        self._room.register(fd, select.POLLOUT)
        self._blocked_since_ns = 0  # 0: the line took what was last offered

    def run(self) -> None:
        """Until the bench says no more, or the line fails."""
        self._report(_READY, _ask_for_priority(), int(_ask_for_punctuality()))
        while True:
            deadline_ns, size, keep = _FRAME.unpack(self._read(_FRAME.size))
            frame = self._read(size)
            self._sleep_until(deadline_ns)
            self._send(deadline_ns, frame, keep=bool(keep))
            # A pseudo-terminal whose far end is gone goes on taking bytes. Looked at after the write, so as not to
            # delay it.
            if any(events & _GONE for _, events in self._hang_up.poll(0)):
                self._fail(errno.EIO, deadline_ns)

    def _read(self, size: int) -> bytes:
        data = self._control.recv(size, socket.MSG_WAITALL)
        if len(data) < size:
            sys.exit()
        return data

    def _report(self, kind: int, first: int, second: int) -> None:
        self._control.sendall(_REPORT.pack(kind, first, second))

    def _fail(self, code: int, deadline_ns: int) -> NoReturn:
        self._report(_FAILED, code, deadline_ns)
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
            self._report(_DROPPED, 0, 0)
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
                    self._report(_STALLED, 0, 0)
                waited = True
                self._blocked_since_ns = self._blocked_since_ns or now_ns
                if now_ns - self._blocked_since_ns >= self._stall_limit_ns:
                    self._fail(errno.ETIMEDOUT, deadline_ns)
                may_drop = len(left) == len(frame) and not keep
                if may_drop and now_ns >= give_up_ns:
                    self._report(_DROPPED, 0, 0)
                    return
                wait_ns = min(_LOOK_NS, give_up_ns - now_ns) if may_drop else _LOOK_NS
                # Milliseconds, rounded up: a short wait must not become a busy loop.
                if any(events & _GONE for _, events in self._room.poll(-(-wait_ns // 1_000_000))):
                    self._fail(errno.EIO, deadline_ns)
                if self._bench_left.poll(0):
                    sys.exit()
            except OSError as error:
                self._fail(error.errno or errno.EIO, deadline_ns)
            now_ns = time.monotonic_ns()
        # `now_ns` was taken right before the write that took the last byte: a frame is no sample before it is whole.
        self._report(_SENT_KEPT if keep else _SENT, deadline_ns, now_ns)


if __name__ == "__main__":
    gc.disable()
    with suppress(ConnectionError):  # the bench has ended
        _Process(*(int(word) for word in sys.argv[1:])).run()
