"""A pseudo-terminal: a serial cable inside the kernel.

The bench holds one end; the other end has a path, and a program that opens it with pyserial cannot distinguish it from
a real port. So the mocked flight controller has a real serial link on a machine without hardware.
"""

from __future__ import annotations

import os
import tty

from firmware_bridge.transports.fd_stream import FdStream, StreamTransport
from signals.errors import PortNotFound


class PtyTransport(StreamTransport):
    """Creates the pair on `open`; `far_path` is the path of the far side's end.

    Until the first byte arrives the far end is also held open here: otherwise a far side that has not connected yet
    would look like one that has hung up. After the first byte, its closing (or crash) ends the link.
    """

    def __init__(self) -> None:
        self._bench_end: int | None = None
        self._far_end: int | None = None
        self._far_path = ""

    @property
    def name(self) -> str:
        return f"pty {self._far_path}" if self._far_path else "pty"

    @property
    def far_path(self) -> str:
        """Path of the far end. Empty before `open`."""
        return self._far_path

    def open(self) -> None:
        try:
            self._bench_end, self._far_end = os.openpty()
        except OSError as error:
            raise PortNotFound(
                "pty", f"the system gives no pseudo-terminal ({error.strerror}); is /dev/pts mounted?"
            ) from error
        self._far_path = os.ttyname(self._far_end)
        # Raw in both directions from the start: bytes written before the far side has configured its end stay intact.
        tty.setraw(self._far_end)
        self._stream = FdStream(self._bench_end, self.name)

    def close(self) -> None:
        self._stream = None
        self._close_far_end()
        descriptor, self._bench_end = self._bench_end, None
        if descriptor is not None:
            os.close(descriptor)

    def _close_far_end(self) -> None:
        descriptor, self._far_end = self._far_end, None
        if descriptor is not None:
            os.close(descriptor)

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        if data and self._far_end is not None:
            self._close_far_end()
        return data

    def fileno(self) -> int | None:
        return self._bench_end
