"""UDP datagrams to and from one peer."""

from __future__ import annotations

import errno
import select
import socket

from hil.signals.errors import LinkClosed, LinkError, PortBusy, PortNotFound

_LOOPBACK = "127.0.0.1"
_DATAGRAM_SIZE = 65536


def bind_udp(address: tuple[str, int], name: str) -> socket.socket:
    """A socket that never waits, bound to `address` (port 0: any free one). PortBusy or PortNotFound say why not."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.bind(address)
    except (OSError, OverflowError) as error:
        sock.close()
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            raise PortBusy(name, "another program has this port; stop it or choose another port") from error
        raise PortNotFound(name, f"cannot be bound on this machine ({error})") from error
    sock.setblocking(False)
    return sock


class UdpTransport:
    """Binds `host`:`port` (0: any free one). The peer is the one given, or whoever sent the latest datagram.

    There is no far side that could be seen to close: silence is all that a vanished peer looks like.
    """

    def __init__(self, port: int = 0, *, host: str = _LOOPBACK, peer: tuple[str, int] | None = None) -> None:
        self._address = (host, port)
        self._peer = peer
        self._learn = peer is None
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        to = f" to {self._peer[0]}:{self._peer[1]}" if self._peer else ""
        return f"udp {self._address[0]}:{self._address[1]}{to}"

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

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkClosed(self.name, "the socket is not open")
        return self._socket

    def write(self, data: bytes) -> None:
        """One datagram. LinkClosed if no peer is known yet, LinkError if it is too long for one."""
        sock = self._open_socket()
        if self._peer is None:
            raise LinkClosed(self.name, "nobody has sent anything yet, so there is no address to answer to")
        try:
            try:
                sock.sendto(data, self._peer)
            except BlockingIOError:
                select.select([], [sock], [], 1.0)
                sock.sendto(data, self._peer)
        except ConnectionRefusedError:
            pass  # an ICMP echo of an earlier datagram: the peer is not up yet, which UDP does not promise to tell
        except OSError as error:
            raise LinkError(self.name, f"cannot send {len(data)} bytes ({error.strerror})") from error

    def read(self, timeout_s: float) -> bytes:
        """One datagram."""
        sock = self._open_socket()
        if not select.select([sock], [], [], max(timeout_s, 0.0))[0]:
            return b""
        try:
            data, sender = sock.recvfrom(_DATAGRAM_SIZE)
        except (BlockingIOError, ConnectionRefusedError):
            return b""
        if self._learn:
            self._peer = sender
        elif sender != self._peer:
            return b""
        return data

    def fileno(self) -> int | None:
        return None if self._socket is None else self._socket.fileno()
