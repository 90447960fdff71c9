"""UDP datagrams: each with its sender's address (`UdpInbox`), or to and from the latest sender (`UdpTransport`)."""

from __future__ import annotations

import errno
import select
import socket

from signals.errors import LinkClosed, LinkError, PortBusy, PortNotFound

Address = tuple[str, int]
_LOOPBACK = "127.0.0.1"
_DATAGRAM_SIZE = 65536
_RECEIVE_BUFFER = 4 * 1024 * 1024


class UdpInbox:
    """Binds `host`:`port` (0: any free one). Calls never wait: poll `fileno`.

    UDP has no connection that could end: a peer that has gone is only silent.
    """

    def __init__(self, port: int = 0, *, host: str = _LOOPBACK) -> None:
        self._address: Address = (host, port)
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        return f"udp {self._address[0]}:{self._address[1]}"

    @property
    def port(self) -> int:
        """The bound port; known after `open` if 0 was given."""
        return self._address[1]

    def open(self) -> None:
        """Bind. PortBusy or PortNotFound if that fails."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            sock.bind(self._address)
        except (OSError, OverflowError) as error:
            sock.close()
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortBusy(self.name, "another program has this port; stop it or choose another port") from error
            raise PortNotFound(
                self.name, f"cannot be bound on this machine ({error}); choose one of its addresses"
            ) from error
        sock.setblocking(False)
        self._address = (self._address[0], sock.getsockname()[1])
        self._socket = sock

    def close(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()

    def receive(self) -> tuple[bytes, Address] | None:
        """Return the oldest received datagram and its sender, or None."""
        while True:
            try:
                return self._open_socket().recvfrom(_DATAGRAM_SIZE)
            except BlockingIOError:
                return None
            except ConnectionError:
                continue  # an ICMP report about a datagram sent earlier

    def send(self, data: bytes, to: Address) -> None:
        """Send one datagram. Its loss is not reported. LinkError if the system refuses it."""
        try:
            self._open_socket().sendto(data, to)
        except (BlockingIOError, ConnectionError):
            return  # lost, as datagrams may be
        except OSError as error:
            raise LinkError(
                self.name, f"cannot send {len(data)} bytes to {to[0]}:{to[1]} ({error.strerror}); is the address right?"
            ) from error

    def fileno(self) -> int | None:
        """Return the descriptor; None while it is not open."""
        return None if self._socket is None else self._socket.fileno()

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkClosed(self.name, "the socket is not open; call `open` first")
        return self._socket


class UdpTransport(UdpInbox):
    """A transport whose far side is the sender of the latest datagram."""

    _peer: Address | None = None

    def write(self, data: bytes) -> None:
        """Send one datagram. LinkClosed before the first datagram has come, LinkError if it is too long."""
        sock = self._open_socket()
        if self._peer is None:
            raise LinkClosed(
                self.name, "no datagram has come yet, so there is no address to send to; is the program there started?"
            )
        select.select([], [sock], [], 1.0)
        self.send(data, self._peer)

    def read(self, timeout_s: float) -> bytes:
        """Return the next datagram, waiting up to `timeout_s` for it; b"" if none came."""
        sock = self._open_socket()
        if timeout_s > 0.0:
            select.select([sock], [], [], timeout_s)
        found = self.receive()
        if found is None:
            return b""
        data, self._peer = found
        return data
