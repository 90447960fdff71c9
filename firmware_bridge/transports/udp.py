"""UDP datagrams: from anybody, each with its sender (`UdpInbox`), or to and from the last speaker (`UdpTransport`)."""

from __future__ import annotations

import errno
import select
import socket

from hil.signals.errors import LinkClosed, LinkError, PortBusy, PortNotFound

Address = tuple[str, int]
_LOOPBACK = "127.0.0.1"
_DATAGRAM_SIZE = 65536
_RECEIVE_BUFFER = 4 * 1024 * 1024


class UdpInbox:
    """Binds `host`:`port` (0: any free one). Never waits: poll `fileno`.

    There is no far side that could be seen to close: silence is all that a vanished peer looks like.
    """

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
        """PortBusy or PortNotFound say why the port cannot be had."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            sock.bind(self._address)
        except (OSError, OverflowError) as error:
            sock.close()
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortBusy(self.name, "another program has this port; stop it or choose another port") from error
            raise PortNotFound(self.name, f"cannot be bound on this machine ({error})") from error
        sock.setblocking(False)
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

    def fileno(self) -> int | None:
        """None while it is not open."""
        return None if self._socket is None else self._socket.fileno()

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkClosed(self.name, "the socket is not open")
        return self._socket


class UdpTransport(UdpInbox):
    """A transport whose far side is whoever sent the latest datagram."""

    _peer: Address | None = None

    def write(self, data: bytes) -> None:
        """One datagram. LinkClosed if nobody has been heard yet, LinkError if it is too long for one."""
        sock = self._open_socket()
        if self._peer is None:
            raise LinkClosed(self.name, "nobody has sent anything yet, so there is no address to answer to")
        select.select([], [sock], [], 1.0)
        self.send(data, self._peer)

    def read(self, timeout_s: float) -> bytes:
        """One datagram."""
        sock = self._open_socket()
        if timeout_s > 0.0:
            select.select([sock], [], [], timeout_s)
        found = self.receive()
        if found is None:
            return b""
        data, self._peer = found
        return data
