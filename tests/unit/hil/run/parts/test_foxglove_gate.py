"""The gate in front of Foxglove's server: who is passed on, unchanged, and who is not."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from hil.config import load_bench
from hil.run.parts.links.foxglove import gate as gates
from hil.run.parts.links.foxglove.gate import Gate, inner_addresses
from signals.errors import ConfigError, PortBusy, PortNotFound
from tests.worlds.patience import PATIENCE_S, until

APP = "https://app.foxglove.dev"


class Echo:
    """A server that returns all bytes of a connection, and then ends it."""

    def __init__(self) -> None:
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.address = self.listening.getsockname()[:2]
        self.connections = 0
        self.clients: list[socket.socket] = []
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self.listening.accept()
                self.connections += 1
                self.clients.append(client)
                threading.Thread(target=self._echo, args=(client,), daemon=True).start()

    def _echo(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            while data := client.recv(1 << 16):
                client.sendall(data)


@pytest.fixture
def echo() -> Iterator[Echo]:
    server = Echo()
    yield server
    server.listening.close()


@pytest.fixture
def gate(echo: Echo) -> Iterator[Gate]:
    gate = Gate("127.0.0.1", 0, loopback_only=True, sites=[APP])
    gate.start(echo.address)
    yield gate
    gate.close(1.0)


def request(*lines: str) -> bytes:
    return "\r\n".join(("GET / HTTP/1.1", *lines, "Upgrade: websocket", "Connection: Upgrade", "", "")).encode()


def answer(gate: Gate, data: bytes) -> bytes:
    """Send a request and nothing more; return all that comes."""
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) as client:
        client.sendall(data)
        with suppress(OSError):
            client.shutdown(socket.SHUT_WR)
        received = b""
        with suppress(ConnectionResetError):
            while piece := client.recv(1 << 16):
                received += piece
        return received


@pytest.mark.parametrize(
    "lines",
    [
        ("Host: 127.0.0.1:8765",),  # a program
        ("Host: LOCALHOST:8765", f"Origin: {APP}"),
        ("Host: [::1]:8765", "origin: HTTPS://APP.foxglove.dev"),
    ],
)
def test_programs_and_named_pages_are_passed_on_unchanged(gate: Gate, lines: tuple[str, ...]) -> None:
    data = request(*lines) + bytes(range(256)) * 4000
    assert answer(gate, data) == data
    assert not gate.refusals


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        (("Host: 127.0.0.1:8765", "Origin: https://evil.example"), 403),
        (("Host: 127.0.0.1:8765", f"Origin: {APP}.evil.example"), 403),
        (("Host: 127.0.0.1:8765", "Origin: http://app.foxglove.dev"), 403),
        (("Host: 127.0.0.1:8765", "Origin: http://127.0.0.1:8765"), 403),  # it serves no page
        (("Host: 127.0.0.1:8765", "Origin: null"), 403),
        (("Host: 127.0.0.1:8765", "Origin: file://"), 403),
        (("Host: 127.0.0.1:8765", "Origin: "), 403),
        (("Host: evil.example:8765", f"Origin: {APP}"), 403),
        (("Host: 127.0.0.1.evil.example",), 403),
        (("Host: 10.0.0.5:8765",), 403),
        (("Host: evil.example", "Host: 127.0.0.1"), 400),
        (("Host: 127.0.0.1", f"Origin: {APP}", "Origin: https://evil.example"), 400),
        ((), 400),
    ],
)
def test_others_are_refused_and_told_once(gate: Gate, echo: Echo, lines: tuple[str, ...], status: int) -> None:
    for _ in range(2):
        assert answer(gate, request(*lines)).startswith(b"HTTP/1.1 %d " % status)
    assert echo.connections == 0
    assert len(gate.refusals) == 1
    assert answer(gate, request("Host: localhost")) == request("Host: localhost")


def test_pages_are_checked_on_other_addresses_too(echo: Echo) -> None:
    gate = Gate("127.0.0.1", 0, loopback_only=False, sites=[APP])
    gate.start(echo.address)
    for lines in (("Host: bench.example:8765",), ("Host: bench.example:8765", f"Origin: {APP}")):
        assert answer(gate, request(*lines)) == request(*lines)
    rebound = request("Host: evil.example:8765", "Origin: http://evil.example:8765")
    assert answer(gate, rebound).startswith(b"HTTP/1.1 403 ")
    gate.close(1.0)


@pytest.mark.parametrize(
    "data",
    [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"\x16\x03\x01\x02\r\n\r\n", b"x" * 100_000, b"\r\n" * 100,
     b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000, b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\nabc"],
)  # fmt: skip
def test_what_is_no_request_reaches_nobody(gate: Gate, echo: Echo, data: bytes) -> None:
    assert b"abc" not in answer(gate, data)
    assert echo.connections == 0


def test_a_slow_request_is_given_up(gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gates, "_HEAD_S", 0.05)
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) as client:
        client.sendall(b"GET / HT")
        assert client.recv(1) == b""


def test_there_is_a_limit_of_clients(gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gates, "_MOST_CLIENTS", 3)
    data = request("Host: 127.0.0.1")
    clients = [socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) for _ in range(3)]
    for client in clients:
        client.sendall(data)
        assert client.recv(len(data)) == data
    assert answer(gate, data) == b""
    clients.pop().close()
    until(lambda: answer(gate, data) == data, "a place")
    for client in clients:
        client.close()


def test_the_end_of_the_server_ends_its_clients(gate: Gate, echo: Echo) -> None:
    data = request("Host: 127.0.0.1")
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) as client:
        client.sendall(data)
        assert client.recv(len(data)) == data
        gate.close(0.01)
        assert client.recv(1) == b""
    with pytest.raises(OSError):  # noqa: PT011 (refused, or reset)
        socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S)


def test_ports_that_cannot_be_had_are_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        with pytest.raises(PortBusy, match=f"127.0.0.1:{port}: Foxglove's server cannot listen there: another"):
            Gate("127.0.0.1", port, loopback_only=True, sites=[])
    with pytest.raises(PortNotFound, match=r"192.0.2.7:0: .*set foxglove.host and foxglove.port"):
        Gate("192.0.2.7", 0, loopback_only=False, sites=[])


def test_no_browser_connects_to_the_addresses_behind_the_gate() -> None:
    blocked = range(6665, 6670)  # https://fetch.spec.whatwg.org/#port-blocking
    addresses = list(inner_addresses())
    assert all(re.fullmatch(r"127\.\d+\.\d+\.\d+", host) and port in blocked for host, port in addresses)
    assert len(set(addresses)) == len(addresses)


@pytest.mark.parametrize("origin", ["*", "null", "https://*.foxglove.dev", "app.foxglove.dev", "https://a.b/c", ""])
def test_origins_that_name_no_page_are_refused(origin: str) -> None:
    with pytest.raises(ConfigError, match="must be the origin of a page"):
        load_bench(None, settings=[f"foxglove.origins=['{origin}']"])


def test_origins_of_other_pages() -> None:
    settings = ["foxglove.origins=[HTTP://localhost:8080, 'file://']"]
    assert load_bench(None, settings=settings).config.foxglove.origins == ("http://localhost:8080", "file://")


def test_the_last_text_is_waited_for_until_slow_clients_have_it(gate: Gate, echo: Echo) -> None:
    head, load, text = request("Host: localhost"), bytes(16 << 20), "the end"
    received = [bytearray(), bytearray()]

    def read(client: socket.socket, into: bytearray, pause_s: float) -> None:
        while not into.endswith(text.encode()) and (piece := client.recv(1 << 16)):
            into += piece
            time.sleep(pause_s)

    def say(text: str) -> None:  # as a server whose queues are full
        for client in echo.clients:
            threading.Thread(target=client.sendall, args=(load + text[:3].encode(),), daemon=True).start()
        for client, into in zip(clients, received, strict=True):
            threading.Thread(target=read, args=(client, into, 0.001), daemon=True).start()
        assert until(lambda: all(len(each) > len(load) for each in received))
        for client in echo.clients:
            client.sendall(text[3:].encode())

    clients = [socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) for _ in received]
    for client in clients:
        client.sendall(head)
        assert client.recv(1 << 16) == head
    gate.pass_on_last(text, say, idle_s=PATIENCE_S)
    assert not gate.waits_for_clients
    assert until(lambda: all(each.endswith(text.encode()) for each in received))


def test_a_client_that_reads_nothing_ends_the_wait(gate: Gate, echo: Echo) -> None:
    head = request("Host: localhost")
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) as client:
        client.sendall(head)
        assert client.recv(1 << 16) == head

        def send() -> None:
            with suppress(OSError):
                echo.clients[0].sendall(bytes(64 << 20))

        sends = threading.Thread(target=send, daemon=True)
        gate.pass_on_last("the end", lambda text: sends.start(), idle_s=0.3)
        assert gate.waits_for_clients
