"""The bench's end of the real-time sender: pushes frames to the process that writes them, and counts its reports.

    bench      push(deadline, bytes) -> a socket pair ->
    process    wait until the deadline; write; report how late the write was       (`sender_process`)

A free-running autopilot stamps samples on arrival, so a late write is a wrong sample.
"""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field

from firmware_bridge.links.realtime import sender_process
from firmware_bridge.links.realtime.sender_process import (
    DROPPED,
    FAILED,
    FRAME,
    ISOLATED,
    MEMORY,
    PRIORITY,
    REPORT,
    SENT,
    SENT_KEPT,
    SLACK,
    STALLED,
)
from signals.errors import LinkClosed
from signals.latency import LatencyHistogram
from signals.time import NS_PER_MS

LONGEST_FRAME = 4096
_SOCKET_BYTES = 256 * 1024  # more than the pending frames: a push never waits
_STOP_S = 10.0
_REMEDY = (
    "to get it, add `rtprio 90` and `memlock unlimited` for your user to /etc/security/limits.conf and log in again, "
    "or run `sudo setcap cap_sys_nice,cap_ipc_lock+ep` on the Python program"
)


@dataclass
class SendStats:
    """Counts of frames since the line was opened. `pushed` = `sent` + `dropped` + `pending`, unless it was renewed."""

    # Of the frames sent: right before the write that took the last byte, minus deadline.
    lateness: LatencyHistogram = field(default_factory=LatencyHistogram)
    pushed: int = 0
    sent: int = 0
    dropped: int = 0  # stale, or the line was full until a period after the deadline
    refused: int = 0  # by `push`: too many frames were pending
    stalled: int = 0  # had to wait because the line was full
    pending: int = 0
    longest_gap_ns: int = 0  # between two samples written
    late_2ms: int = 0
    late_20ms: int = 0
    scheduling: str = "no sender process: declared faults wrap the line"  # granted to the sender process
    denied: tuple[str, ...] = ()  # asked for by the sender process and not granted, each with its remedy

    def count_lateness(self, lateness_ns: int) -> None:
        self.lateness.add(lateness_ns)
        self.late_2ms += lateness_ns > 2 * NS_PER_MS
        self.late_20ms += lateness_ns > 20 * NS_PER_MS


class RealtimeSender:
    """Starts the sender process and counts its reports in `stats`, which may hold the counts of an earlier sender.

    Makes `fd` non-blocking. The process sends on its own copy of `fd` until `stop`. OSError for another number.
    """

    def __init__(
        self,
        fd: int,
        stats: SendStats,
        *,
        period_ns: int,
        max_pending: int = 16,
        stall_limit_ns: int = 5_000_000_000,
        stale_ns: int = 0,
    ) -> None:
        os.fstat(fd)
        self.stats = stats
        stats.pending = 0
        self.error: tuple[int, int] | None = None  # errno, and the deadline of the frame that met it [ns]
        self._max_pending = max_pending
        self._pid = os.getpid()
        self._stopped = False
        self._reports = b""
        self._last_sent_ns = 0
        self._control, process_end = socket.socketpair()
        self._control.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
        with process_end:
            arguments = [str(n) for n in (fd, process_end.fileno(), period_ns, stale_ns, stall_limit_ns)]
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", sender_process.__file__, *arguments],
                pass_fds=(fd, process_end.fileno()),
                stdin=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C at the terminal reaches the bench only
            )
        self._take(self._control.recv(REPORT.size, socket.MSG_WAITALL))  # READY, with the scheduling it was granted
        self._control.setblocking(False)

    def push(self, deadline_ns: int, frame: bytes, *, keep: bool = False) -> bool:
        """Queue a frame without waiting. Returns False if too many are pending, or the sender stopped or failed.

        `keep`: send it however late (commands). Other frames are dropped once stale.
        """
        if not 0 < len(frame) <= LONGEST_FRAME:
            raise ValueError(f"{len(frame)} bytes in one frame; 1 to {LONGEST_FRAME} can be sent")
        self.collect()
        stats = self.stats
        if self._stopped or self.error is not None or stats.pending >= self._max_pending:
            stats.refused += 1
            return False
        self._control.setblocking(True)  # the socket's buffer is large enough
        with suppress(OSError):  # the process has ended: its last report says why
            self._control.sendall(FRAME.pack(deadline_ns, len(frame), keep) + frame)
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
                self.error = (errno.ECHILD, self._last_sent_ns)  # killed from outside

    def failure(self, port: str) -> LinkClosed | None:
        """Return the error to raise if the process has ended by itself, or None."""
        self.collect()
        if self.error is None:
            return None
        code, deadline_ns = self.error
        if code == errno.ETIMEDOUT:
            what = "the far side takes no bytes any more; is it hung, or not reading?"
        elif code in (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EPIPE, errno.ECONNRESET):
            what = f"the far side hung up, or the device was unplugged ({os.strerror(code)})"
        else:
            what = f"cannot be written to ({os.strerror(code)})"
        return LinkClosed(port, f"{what}, at the frame due at {deadline_ns * 1e-9:.6f} s of the monotonic clock")

    def _take(self, data: bytes) -> None:
        stats = self.stats
        data = self._reports + data
        whole = len(data) - len(data) % REPORT.size
        self._reports = data[whole:]
        for kind, first, second in REPORT.iter_unpack(data[:whole]):
            if kind in (SENT, SENT_KEPT):
                stats.count_lateness(max(second - first, 0))
                stats.sent += 1
                stats.pending -= 1
                if kind == SENT:
                    if self._last_sent_ns:
                        stats.longest_gap_ns = max(stats.longest_gap_ns, second - self._last_sent_ns)
                    self._last_sent_ns = second
            elif kind == DROPPED:
                stats.dropped += 1
                stats.pending -= 1
            elif kind == STALLED:
                stats.stalled += 1
            elif kind == FAILED:
                self.error = (first, second)
            else:
                stats.scheduling = _scheduling(first, memory_locked=bool(second & MEMORY))
                stats.denied = denied(first, second)

    def stop(self) -> None:
        """End the process. Frames whose deadline has not come stay unsent. May be called any number of times."""
        if self._stopped:
            return
        if os.getpid() == self._pid:  # a forked child must not end the process of its parent
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


def denied(priority: int, grants: int) -> tuple[str, ...]:
    """Return what a process asked for and was not granted. `grants` are MEMORY, SLACK and ISOLATED."""
    refusals = (
        (priority > 0, f"real-time priority ({_REMEDY})"),
        (grants & MEMORY, "locked memory" if priority <= 0 else f"locked memory ({_REMEDY})"),
        (grants & SLACK, "exact timers (this system cannot reduce its timer slack)"),
        (grants & ISOLATED, "a processor of its own (`isolcpus=N` on the kernel's command line reserves one)"),
    )
    return tuple(text for granted, text in refusals if not granted)


def _scheduling(priority: int, *, memory_locked: bool) -> str:
    """Describe the scheduling that the process was granted. `priority` below 0 is the errno of the refusal."""
    memory = "memory locked" if memory_locked else "memory not locked"
    if priority > 0:
        return f"SCHED_FIFO {priority}, {memory}"
    if -priority == errno.EPERM:
        return f"normal scheduling (no permission for SCHED_FIFO {PRIORITY}: {_REMEDY}), {memory}"
    return f"normal scheduling (SCHED_FIFO {PRIORITY} refused: {os.strerror(-priority)}), {memory}"
