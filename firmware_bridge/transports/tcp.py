"""TCP, as client and as server with one client. Nagle's algorithm is off: a tick's bytes leave at once."""

from __future__ import annotations

import errno
import select
import socket
import time

from firmware_bridge.transports.fd_stream import FdStream, StreamTransport
from signals.errors import LinkClosed, LinkError, PortBusy, PortNotFound

_LOOPBACK = "127.0.0.1"


class TcpClient(StreamTransport):
    """Connects to `host`:`port` on `open`."""

    def __init__(self, port: int, *, host: str = _LOOPBACK, connect_limit_s: float = 5.0) -> None:
        self._address = (host, port)
        self._connect_limit_s = connect_limit_s
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        return f"tcp {self._address[0]}:{self._address[1]}"

    @property
    def port(self) -> int:
        """The port connected to."""
        return self._address[1]

    def open(self) -> None:
        """Connect. PortNotFound if there is no listener within the limit."""
        try:
            self._socket = socket.create_connection(self._address, timeout=self._connect_limit_s)
        except OSError as error:
            raise PortNotFound(
                self.name, f"no connection ({error}); is the program there started, on this port?"
            ) from error
        self._stream = _stream(self._socket, self.name)

    def close(self) -> None:
        self._stream = None
        _close(self._socket)
        self._socket = None

    def fileno(self) -> int | None:
        return None if self._socket is None else self._socket.fileno()


class TcpServer(StreamTransport):
    """Listens on `host`:`port` (0: any free port) and serves the first client that connects.

    The client may connect at any time after `open`; `read` waits for it first. A second connection is not accepted
    after the first has ended: PX4 SITL, for which this is made, connects only once.
    """

    def __init__(self, port: int, *, host: str = _LOOPBACK) -> None:
        self._address = (host, port)
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        return f"tcp server {self._address[0]}:{self._address[1]}"

    @property
    def port(self) -> int:
        """The port listened on; known after `open` if 0 was given."""
        return self._address[1]

    def open(self) -> None:
        """Bind and listen.

        PortBusy if another program has the port, PortNotFound if the host is not this machine.
        """
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        # Without this a run just after another one finds its own port "in use" for a minute.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(self._address)
            listener.listen(1)
        except (OSError, OverflowError) as error:
            listener.close()
            raise _bind_refusal(self.name, error) from error
        self._address = (self._address[0], listener.getsockname()[1])
        self._listener = listener

    def close(self) -> None:
        self._stream = None
        _close(self._socket)
        _close(self._listener)
        self._socket = self._listener = None

    def _accept(self, timeout_s: float) -> bool:
        if self._listener is None:
            raise LinkClosed(self.name, "the server is not open; call `open` first")
        if not select.select([self._listener], [], [], max(timeout_s, 0.0))[0]:
            return False
        self._socket, peer = self._listener.accept()
        self._stream = _stream(self._socket, f"{self.name} (client {peer[0]}:{peer[1]})")
        return True

    def write(self, data: bytes) -> None:
        """Send all of `data`. LinkClosed while no client has connected."""
        stream = self._stream
        if stream is None:
            if not self._accept(0.0):
                raise LinkClosed(self.name, "no client has connected yet; is the program there started?")
            stream = self._opened()
        stream.write(data)

    def read(self, timeout_s: float) -> bytes:
        stream = self._stream
        if stream is None:
            start = time.monotonic()
            if not self._accept(timeout_s):
                return b""
            timeout_s = max(0.0, timeout_s - (time.monotonic() - start))
            stream = self._opened()
        return stream.read(timeout_s)

    def fileno(self) -> int | None:
        active = self._socket or self._listener
        return None if active is None else active.fileno()


def _stream(connection: socket.socket, name: str) -> FdStream:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setblocking(False)
    return FdStream(connection.fileno(), name)


def _close(connection: socket.socket | None) -> None:
    if connection is not None:
        connection.close()


def _bind_refusal(name: str, error: Exception) -> LinkError:
    """Return the named error for a failed bind."""
    code = getattr(error, "errno", None)
    if code == errno.EADDRINUSE:
        return PortBusy(name, "another program has this port; stop it or choose another port")
    if code == errno.EACCES:
        return LinkError(name, "no permission to bind; ports below 1024 need root, choose another")
    return PortNotFound(name, f"cannot be bound on this machine ({error}); choose one of its addresses")
