"""The second wire of a simulated PX4: ordinary MAVLink over UDP, beside the simulator's own TCP connection.

PX4 SITL takes missions, commands and set-points there, on a thread of its own that runs on wall-clock time. So that
they take effect at the simulated time at which they were sent, they leave before the tick's HIL_SENSOR, and the tick
is held back until PX4 has read them: simulated time stands still meanwhile.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable
from pathlib import Path

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from hil.signals.errors import LinkClosed, PortNotFound

_DATAGRAM_LIMIT = 1400  # PX4 reads datagrams of at most 1600 bytes
_DATAGRAM_SIZE = 65536
_TAKEN_LIMIT_S = 0.05
# Allowance, not measured, for PX4's receiver thread from "read from the socket" to "acted upon".
_ACT_S = 0.0003
_PROC_UDP = Path("/proc/net/udp")
_RECEIVE_BUFFER = 4 * 1024 * 1024


class GroundChannel:
    """MAVLink datagrams to and from `127.0.0.1:port`, from a port of our own."""

    def __init__(self, port: int, *, host: str = "127.0.0.1") -> None:
        self._peer = (host, port)
        self._socket: socket.socket | None = None
        self._parser = FrameParser()
        self._far_port = f":{port:04X}"
        self.tx_bytes = 0
        self.rx_bytes = 0

    @property
    def name(self) -> str:
        return f"udp {self._peer[0]}:{self._peer[1]}"

    @property
    def parser(self) -> FrameParser:
        """Its counters tell how clean the line is."""
        return self._parser

    def open(self) -> None:
        self._parser = FrameParser()
        self.tx_bytes = self.rx_bytes = 0
        try:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.bind((self._peer[0], 0))
        except OSError as error:
            self.close()
            raise PortNotFound(self.name, f"no socket can be had for it ({error.strerror})") from error
        self._socket.setblocking(False)

    def close(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()

    def write(self, data: bytes) -> None:
        """Send whole frames, and wait until the far side has read them (at most 50 ms: it may not be up yet)."""
        sock = self._open_socket()
        for datagram in _datagrams(data):
            try:
                sock.sendto(datagram, self._peer)
            except OSError:
                continue  # nobody there yet, or no room: MAVLink's services ask again
            self.tx_bytes += len(datagram)
        self._wait_until_taken()

    def read(self) -> list[Frame]:
        """Frames of every datagram that has arrived. Never waits."""
        sock = self._open_socket()
        frames: list[Frame] = []
        while True:
            try:
                data = sock.recv(_DATAGRAM_SIZE)
            except BlockingIOError:
                return frames
            except OSError:
                continue  # an ICMP report about an earlier datagram
            self.rx_bytes += len(data)
            frames += self._parser.feed(data)

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkClosed(self.name, "the socket is not open")
        return self._socket

    def _wait_until_taken(self) -> None:
        deadline = time.monotonic() + _TAKEN_LIMIT_S
        while self._unread() and time.monotonic() < deadline:
            time.sleep(0.00005)
        time.sleep(_ACT_S)

    def far_side_bound(self) -> bool:
        """Whether a program listens on the far port: a PX4 that has started. False where the system does not tell."""
        return self._far_socket() is not None

    def _unread(self) -> bool:
        """Whether bytes wait in the far side's socket. False where the system does not tell."""
        fields = self._far_socket()
        return fields is not None and fields[4].partition(":")[2] != "00000000"

    def _far_socket(self) -> list[str] | None:
        """The system's line about the socket on the far port."""
        try:
            lines = _PROC_UDP.read_text().splitlines()[1:]
        except OSError:
            return None
        for line in lines:
            fields = line.split()
            if fields[1].endswith(self._far_port):
                return fields
        return None


def _datagrams(data: bytes) -> Iterable[bytes]:
    """`data`, whole frames, cut into datagrams at their borders."""
    start = pos = 0
    while pos < len(data):
        size = frame_size(data, pos)
        if pos + size - start > _DATAGRAM_LIMIT and pos > start:
            yield data[start:pos]
            start = pos
        pos += size
    if start < pos:
        yield data[start:pos]


def frame_size(data: bytes, pos: int) -> int:
    """Bytes of the frame that begins at `pos`: MAVLink 1, MAVLink 2, signed or not."""
    if data[pos] == 0xFD and pos + 2 < len(data):
        return 12 + data[pos + 1] + (13 if data[pos + 2] & 1 else 0)
    return 8 + data[pos + 1] if pos + 1 < len(data) else 1
