"""MAVLink beside the JSON interface: commands to ArduPilot SITL, and its telemetry.

UDP (`--serial0 udpclient:127.0.0.1:PORT`): SITL sends to the bench's port from a port of its own, which changes at each
reboot. TCP (its default): SITL waits for the bench on 5760 + 10 * instance, before its first servo packet and again
after every reboot; and it stands still while a TCP client leaves more than 1 kB unread.

SITL serves one client on each of its TCP ports. A second one connects too, and hears nothing: where another program has
the port, such as MAVProxy of sim_vehicle.py, that is a PortBusy which names it.

SITL reads its serial port once per step, right after the step's state has come: bytes written before the state take
effect in that step.
"""

from __future__ import annotations

import time

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser, datagrams, split_frames
from firmware_bridge.transports.port_client import other_client
from firmware_bridge.transports.tcp import TcpClient
from firmware_bridge.transports.udp import UdpTransport
from signals.errors import LinkClosed, PortBusy, PortNotFound

_KEPT_LIMIT = 65536
_RETRY_S = 0.1
_NEXT_PORT = 2  # from SITL's SERIAL0 to its SERIAL1


class MavlinkChannel:
    """Frames in and out. Over UDP on `transport`'s port, or to SITL's TCP port, connected as soon as it listens."""

    def __init__(self, transport: UdpTransport | TcpClient) -> None:
        self._transport = transport
        self._tcp = isinstance(transport, TcpClient)
        self._connected = False
        self._retry_at_s = 0.0
        self._kept = b""  # until the autopilot's first bytes show its address
        self.parser = FrameParser()

    @property
    def name(self) -> str:
        return self._transport.name

    @property
    def udp_port(self) -> int | None:
        """The port that SITL sends to; None over TCP. Known after `open`."""
        return self._transport.port if isinstance(self._transport, UdpTransport) else None

    def open(self) -> None:
        """Bind over UDP. Over TCP every `read` tries to connect, since SITL may not run yet."""
        self.parser = FrameParser()
        self._kept = b""
        self._retry_at_s = 0.0
        self._connected = False
        if not self._tcp:
            self._transport.open()

    def close(self) -> None:
        self._transport.close()
        self._connected = False

    def fileno(self) -> int | None:
        """Return the descriptor to poll while waiting; None while there is no connection."""
        return self._transport.fileno() if self._connected or not self._tcp else None

    def restart(self) -> None:
        """Drop the bytes kept for an autopilot that has rebooted."""
        self._kept = b""
        self.parser = FrameParser()
        if self._tcp:
            self._disconnect()

    def write(self, data: bytes) -> None:
        """Send whole frames. They are kept until the autopilot's first frame shows its address."""
        data = self._kept + data
        self._kept = b""
        if not data:
            return
        try:
            if self._tcp:
                if not self._connect():
                    raise LinkClosed(self.name, "not connected yet")
                self._transport.write(data)
            else:
                for datagram, _ in datagrams(frame for _, frame in split_frames(data)):
                    self._transport.write(datagram)
        except LinkClosed:
            self._disconnect()
            self._kept = data if len(data) <= _KEPT_LIMIT else b""

    def read(self) -> list[Frame]:
        """Return the frames that have arrived. Never waits."""
        frames: list[Frame] = []
        if self._tcp and not self._connect():
            return frames
        while True:
            try:
                data = self._transport.read(0.0)
            except LinkClosed:
                self._disconnect()
                return frames
            if not data:
                return frames
            frames += self.parser.feed(data)

    def _connect(self) -> bool:
        if self._connected:
            return True
        now_s = time.monotonic()
        if now_s < self._retry_at_s:
            return False
        try:
            self._transport.open()
        except PortNotFound:
            self._retry_at_s = now_s + _RETRY_S
            return False
        self._connected = True
        assert isinstance(self._transport, TcpClient)
        if (holder := other_client(self._transport.port)) is not None:
            port = self._transport.port + _NEXT_PORT
            raise PortBusy(
                self.name,
                f"{holder} is connected there, and ArduPilot serves one client on a port: take its next one with --set "
                f"autopilot.mavlink_port=tcp:{port}, or end that program (sim_vehicle.py --no-mavproxy starts none)",
            )
        return True

    def _disconnect(self) -> None:
        if self._tcp:
            self._transport.close()
            self._connected = False
