"""Gate in front of the SDK's server, which shows nobody the headers of a request and accepts them all.

Any page in the user's browser could connect to it, watch the run and alter it. The gate has the port that people know.
It reads the head of a request, refuses those of `firmware_bridge.transports.browser_requests`, and passes all other
bytes on unchanged, both ways, in two threads for each connection. Nothing is kept: a client that reads slowly fills the
gate's sockets, and then the SDK's queue, which drops the oldest messages.

The SDK's server behind it listens on loopback at a port to which no browser connects, whatever page asks for it (the
blocked ports of https://fetch.spec.whatwg.org/#port-blocking).
"""

from __future__ import annotations

import errno
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress

from websockets.http11 import Request
from websockets.server import ServerProtocol

from firmware_bridge.transports.browser_requests import refusal
from signals.errors import PortBusy, PortNotFound

_BLOCKED_PORTS = (6666, 6665, 6667, 6668, 6669)
_HEAD_BYTES = 16_384  # of a request, at most
_HEAD_S = 10.0  # longest wait for it
_MOST_CLIENTS = 64
_CHUNK_BYTES = 1 << 18
_TOLD = 20  # refusals that are told, at most

Address = tuple[str, int]


def inner_addresses() -> Iterator[Address]:
    """Return places for the SDK's server, the best first: of 2**24 addresses, which Linux has, none is taken twice."""
    for _ in range(8):
        a, b, c = secrets.token_bytes(3)
        yield f"127.{a}.{b}.{min(max(c, 1), 254)}", _BLOCKED_PORTS[0]
    for port in _BLOCKED_PORTS:
        yield "127.0.0.1", port


class Gate:
    """Listens at once, and passes clients on after `start`."""

    def __init__(self, host: str, port: int, *, loopback_only: bool, sites: Collection[str]) -> None:
        """`sites`: origins of the pages that may connect. Raises PortBusy or PortNotFound."""
        self._loopback_only, self._sites = loopback_only, frozenset(sites)
        self._inner: Address = ("", 0)
        self._sockets: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._clients: set[socket.socket] = set()  # to which bytes are passed on
        self._last = b""
        self._waiting: dict[socket.socket, bytes] = {}  # clients without the last text, and their latest bytes
        self._passed_s = 0.0  # when such a client last got bytes
        self._told: set[str] = set()
        self.refusals: deque[str] = deque()  # for people
        name = f"{host}:{port}"
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._listening = socket.create_server((host, port), family=family, backlog=64)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                text = "Foxglove's server cannot listen there: another program does; set foxglove.port"
                raise PortBusy(name, text) from error
            reason = error.strerror or str(error)
            text = f"Foxglove's server cannot listen there ({reason}); set foxglove.host and foxglove.port"
            raise PortNotFound(name, text) from error

    @property
    def port(self) -> int:
        return int(self._listening.getsockname()[1])

    def start(self, inner: Address) -> None:
        """Pass clients on to the server at `inner`."""
        self._inner = inner
        threading.Thread(target=self._accept, name="foxglove gate", daemon=True).start()

    def pass_on_last(self, text: str, say: Callable[[str], None], idle_s: float) -> None:
        """Let the server say a text, and wait until all clients have it, or get nothing for so long.

        A server that stops drops what its queues hold.
        """
        self._last = text.encode()
        self._waiting = dict.fromkeys(self._clients.copy(), b"")
        self._passed_s = time.monotonic()
        say(text)
        while self.waits_for_clients and time.monotonic() - self._passed_s < idle_s:
            time.sleep(0.002)

    @property
    def waits_for_clients(self) -> bool:
        """True while clients have not got the last text."""
        return bool(self._waiting)

    def close(self, limit_s: float) -> None:
        """Take no more clients, wait for the server to end its connections, and close what is left. Idempotent."""
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)  # wakes `_accept`
        self._listening.close()
        end_s = time.monotonic() + limit_s
        for thread in list(self._threads):
            thread.join(max(0.0, end_s - time.monotonic()))
        for each in list(self._sockets):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listening.accept()
            except OSError as error:
                if self._listening.fileno() < 0 or error.errno == errno.EINVAL:  # closed
                    return
                time.sleep(0.5)  # no descriptor is free
                continue
            self._threads = [thread for thread in self._threads if thread.is_alive()]
            if len(self._threads) >= _MOST_CLIENTS:
                client.close()
                continue
            thread = threading.Thread(target=self._serve, args=(client,), name="foxglove gate", daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, client: socket.socket) -> None:
        self._sockets.add(client)
        with client, suppress(OSError):
            head = self._admitted(client)
            if head:
                with socket.create_connection(self._inner) as server:
                    self._pass_on(client, server, head)
        self._sockets.discard(client)

    def _admitted(self, client: socket.socket) -> bytes:
        """Return the first bytes of a client whose request is accepted; answer any other. Raises OSError."""
        protocol, head, end_s = ServerProtocol(), b"", time.monotonic() + _HEAD_S
        while len(head) < _HEAD_BYTES:
            client.settimeout(max(0.01, end_s - time.monotonic()))
            data = client.recv(4096)
            if not data:
                return b""
            head += data
            protocol.receive_data(data)
            for request in protocol.events_received():
                assert isinstance(request, Request)
                refused = self._refusal(request)
                if refused is None:
                    client.settimeout(None)
                    return head
                client.sendall(protocol.reject(*refused).serialize())
                return b""
            if protocol.close_expected():  # no HTTP
                return b""
        return b""

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        refused = refusal(hosts, origins, loopback_only=self._loopback_only, sites=self._sites)
        if refused is None:
            return None
        status, reason = refused
        who = f"a page of {origins[0]!r:.80}" if origins else f"a request to {', '.join(hosts)!r:.80}"
        text = f"{who} was refused: {reason}"
        if origins:
            text += "; foxglove.origins names the pages that may connect"
        if text not in self._told and len(self._told) < _TOLD:
            self._told.add(text)
            self.refusals.append(text)
        return status, f"{reason}\n"

    def _pass_on(self, client: socket.socket, server: socket.socket, head: bytes) -> None:
        for each in (client, server):
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        server.sendall(head)
        self._sockets.add(server)
        self._clients.add(client)
        back = threading.Thread(target=_copy, args=(server, client, self._passed), name="foxglove gate", daemon=True)
        back.start()
        _copy(client, server)
        back.join()
        self._clients.discard(client)
        self._waiting.pop(client, None)
        self._sockets.discard(server)

    def _passed(self, client: socket.socket, data: memoryview) -> None:
        before = self._waiting.get(client)
        if before is None:
            return
        data_so_far = before + data
        if self._last in data_so_far:
            self._waiting.pop(client, None)
        else:
            self._waiting[client] = data_so_far[-len(self._last) :]
        self._passed_s = time.monotonic()


Passed = Callable[[socket.socket, memoryview], None]


def _copy(source: socket.socket, target: socket.socket, passed: Passed = lambda target, data: None) -> None:  # noqa: ARG005
    """Copy bytes until the source ends, and tell the target. `passed` gets what the target has got."""
    buffer = memoryview(bytearray(_CHUNK_BYTES))
    with suppress(OSError):
        while n := source.recv_into(buffer):
            target.sendall(buffer[:n])
            passed(target, buffer[:n])
    with suppress(OSError):
        target.shutdown(socket.SHUT_WR)
