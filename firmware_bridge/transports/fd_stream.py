"""A byte stream on a file descriptor: the common half of serial ports, pseudo-terminals and TCP."""

from __future__ import annotations

import os
import select
import time

from signals.errors import LinkClosed

_READ_SIZE = 65536
# Both sides may write at once. Bytes that arrive while a long write waits are kept, up to this many: a far
# side that sends more without reading is at fault.
_INBOX_LIMIT = 4 * 1024 * 1024
_WRITE_STALL_S = 5.0

_IN = select.POLLIN | select.POLLHUP | select.POLLERR


class FdStream:
    """Reads and writes `fd` within time limits.

    Does not own the descriptor: the code that opened it closes it.
    """

    __slots__ = ("_fd", "_inbox", "_name", "_poll_in", "_write_stall_s")

    def __init__(self, fd: int, name: str, *, write_stall_s: float = _WRITE_STALL_S) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self._name = name
        self._inbox = b""
        self._write_stall_s = write_stall_s
        poll = select.poll()
        poll.register(fd, select.POLLIN)
        self._poll_in = poll.poll

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        LinkClosed if the far side has disconnected, or takes nothing for `write_stall_s` seconds.
        """
        try:
            sent = os.write(self._fd, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise self._closed(error) from error
        if sent < len(data):
            self._write_slowly(memoryview(data)[sent:])

    def _write_slowly(self, rest: memoryview) -> None:
        """Write to a full line. Meanwhile take in received bytes, so that two writers never deadlock."""
        poll = select.poll()
        poll.register(self._fd, select.POLLIN | select.POLLOUT)
        deadline = time.monotonic() + self._write_stall_s
        while rest:
            left_s = deadline - time.monotonic()
            events = poll.poll(max(1, int(left_s * 1000))) if left_s > 0 else []
            if not events:
                raise LinkClosed(
                    self._name,
                    f"the far side has taken no byte for {self._write_stall_s:g} s with {len(rest)} bytes still to "
                    "send; is it hung, or not reading?",
                )
            if events[0][1] & _IN:
                self._inbox += self._read_now()
                if len(self._inbox) > _INBOX_LIMIT:
                    raise LinkClosed(
                        self._name,
                        f"the far side sent {len(self._inbox)} bytes without reading; is it the right program?",
                    )
            if events[0][1] & select.POLLOUT:
                try:
                    sent = os.write(self._fd, rest)
                except BlockingIOError:
                    continue
                except OSError as error:
                    raise self._closed(error) from error
                rest = rest[sent:]
                deadline = time.monotonic() + self._write_stall_s

    def read(self, timeout_s: float) -> bytes:
        """Return received bytes, waiting up to `timeout_s` for the first.

        LinkClosed after the far side's last byte.
        """
        if self._inbox:
            data, self._inbox = self._inbox, b""
            return data
        # Milliseconds are poll's unit; rounding up keeps a short wait from becoming a busy loop.
        if not self._poll_in(int(timeout_s * 1000.0 + 0.999)):
            return b""
        return self._read_now()

    def _read_now(self) -> bytes:
        try:
            data = os.read(self._fd, _READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._closed(error) from error
        if not data:
            raise LinkClosed(self._name, "the far side closed the connection; did its program end?")
        return data

    def _closed(self, error: OSError) -> LinkClosed:
        return LinkClosed(
            self._name, f"the far side hung up, or the device was unplugged ({error.strerror}); check program and cable"
        )


class StreamTransport:
    """The part of a transport that reads and writes a stream, once `open` has made one."""

    _stream: FdStream | None = None

    @property
    def name(self) -> str:
        raise NotImplementedError

    def write(self, data: bytes) -> None:
        self._opened().write(data)

    def read(self, timeout_s: float) -> bytes:
        return self._opened().read(timeout_s)

    def _opened(self) -> FdStream:
        if self._stream is None:
            raise LinkClosed(self.name, "it is not open; call `open` first")
        return self._stream
