"""UDP datagrams from anybody, each with its sender: who it was is part of what is said."""

from __future__ import annotations

import socket

from firmware_bridge.transports.udp import bind_udp
from hil.signals.errors import LinkClosed, LinkError

Address = tuple[str, int]
_LOOPBACK = "127.0.0.1"
_DATAGRAM_SIZE = 65536


class UdpInbox:
    """Binds `host`:`port` (0: any free one). Never waits: poll `fileno`."""

    def __init__(self, port: int = 0, *, host: str = _LOOPBACK) -> None:
        self._address: Address = (host, port)
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        return f"udp {self._address[0]}:{self._address[1]}"

    @property
    def port(self) -> int:
        """The port bound; known after `open` if 0 was asked for."""
        return self._address[1]

    def open(self) -> None:
        sock = bind_udp(self._address, self.name)
        self._address = (self._address[0], sock.getsockname()[1])
        self._socket = sock

    def close(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()

    def receive(self) -> tuple[bytes, Address] | None:
        """The oldest datagram that has come, and its sender; None if there is none."""
        while True:
            try:
                return self._open_socket().recvfrom(_DATAGRAM_SIZE)
            except BlockingIOError:
                return None
            except ConnectionError:
                continue  # an ICMP report about an earlier datagram of ours

    def send(self, data: bytes, to: Address) -> None:
        """One datagram. That nobody takes it is not told."""
        try:
            self._open_socket().sendto(data, to)
        except (BlockingIOError, ConnectionError):
            return  # lost, as datagrams may be
        except OSError as error:
            raise LinkError(
                self.name, f"cannot send {len(data)} bytes to {to[0]}:{to[1]} ({error.strerror})"
            ) from error

    def fileno(self) -> int:
        return self._open_socket().fileno()

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkClosed(self.name, "the socket is not open")
        return self._socket
