"""The second connection of a simulated PX4: ordinary MAVLink over UDP, beside the simulator's TCP connection.

PX4 SITL takes missions, commands and set-points there, on a thread of its own that runs on wall-clock time. To take
effect at the simulated time at which they are sent, they leave before the tick's HIL_SENSOR, and the tick waits until
PX4 has read them: simulated time stands still meanwhile.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser, datagrams, split_frames
from firmware_bridge.transports.udp import UdpInbox
from signals.errors import LinkError

_READ_LIMIT_S = 0.05
# Allowance, not measured, for PX4's receiver thread from "read from the socket" to "acted upon".
_ACT_S = 0.0003
_PROC_UDP = Path("/proc/net/udp")


class GroundChannel:
    """Exchange of MAVLink datagrams with `port` of this machine; the local port is any free one."""

    def __init__(self, port: int) -> None:
        self._peer = ("127.0.0.1", port)
        self._socket = UdpInbox()
        self._peer_port = f":{port:04X}"
        self.parser = FrameParser()  # counts damaged frames

    @property
    def name(self) -> str:
        return f"udp {self._peer[0]}:{self._peer[1]}"

    def open(self) -> None:
        self.parser = FrameParser()
        self._socket.open()

    def close(self) -> None:
        self._socket.close()

    def write(self, data: bytes) -> None:
        """Send whole frames and wait until the far side has read them, at most 50 ms: it may not run yet."""
        for datagram, _ in datagrams(frame for _, frame in split_frames(data)):
            with suppress(LinkError):  # MAVLink's services repeat their requests
                self._socket.send(datagram, self._peer)
        self._wait_until_read()

    def read(self) -> list[Frame]:
        """Return the frames of every datagram that has arrived. Never waits."""
        frames: list[Frame] = []
        while (found := self._socket.receive()) is not None:
            frames += self.parser.feed(found[0])
        return frames

    def _wait_until_read(self) -> None:
        deadline = time.monotonic() + _READ_LIMIT_S
        while self._unread() and time.monotonic() < deadline:
            time.sleep(0.00005)
        time.sleep(_ACT_S)

    def far_side_bound(self) -> bool:
        """Return True if a program (PX4) listens on PX4's port. False where the system does not report it."""
        return self._peer_socket() is not None

    def _unread(self) -> bool:
        """Return True if bytes wait in the far side's socket. False where the system does not report it."""
        fields = self._peer_socket()
        return fields is not None and fields[4].partition(":")[2] != "00000000"

    def _peer_socket(self) -> list[str] | None:
        """Return the fields of /proc/net/udp for the socket on PX4's port."""
        try:
            lines = _PROC_UDP.read_text().splitlines()[1:]
        except OSError:
            return None
        for line in lines:
            fields = line.split()
            if fields[1].endswith(self._peer_port):
                return fields
        return None
