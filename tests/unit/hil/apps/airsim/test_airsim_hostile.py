"""Hostile clients of the RPC server: memory, numbers of clients and descriptors stay limited, and others are served."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
from collections.abc import Iterator

import msgpack
import pytest

from hil.apps.airsim.rpc import server as rpc_server
from hil.apps.airsim.rpc.arguments import COUNT
from hil.apps.airsim.rpc.framing import MOST_BYTES, MOST_ITEMS
from hil.apps.airsim.rpc.methods import MethodTable, Parameter, method
from hil.apps.airsim.rpc.server import MOST_CLIENTS, RpcServer
from lab.airsim_server import RpcFailed
from tests.worlds.airsim_server import Client
from tests.worlds.patience import PATIENCE_S, until
from tests.worlds.rpc_process import RpcProcess

MIB = 1 << 20
HEAD = b"\x94\x00\x01\xa5count\x91"  # a call whose one argument follows


@pytest.fixture(scope="module")
def process() -> Iterator[RpcProcess]:
    with RpcProcess() as server:
        yield server


def send(client: Client, data: bytes) -> None:
    """Send as much as the server takes."""
    with contextlib.suppress(ConnectionError):
        client.socket.sendall(data)


@pytest.mark.parametrize(
    ("name", "part"),
    [("arrays", b"\x90" * MIB), ("maps", b"\x80" * MIB), ("negative numbers", b"\xe0" * MIB),
     ("maps of one", b"\x81\xd1\x80\x00\x80" * (MIB // 5)), ("texts", b"\xa2ab" * (MIB // 3))],
)  # fmt: skip
def test_a_message_of_small_values_takes_little_memory(process: RpcProcess, name: str, part: bytes) -> None:
    bad = Client(process.port)
    # Twelve arrays, each within every limit of one array.
    send(bad, HEAD + b"\x9c")
    for _ in range(12):
        send(
            bad, b"\xdd" + struct.pack(">I", MIB // 5 if "one" in name else MIB // 3 if name == "texts" else MIB) + part
        )
    assert bad.is_closed()
    assert process.most_bytes() < 48 * MIB
    assert Client(process.port).call("ping") is True


@pytest.mark.parametrize("item", [b"\x80", b"\x81\xd1\x80\x00\x90", b"\xa1\xff"], ids=["maps", "maps of one", "texts"])
def test_a_message_within_the_limits_is_answered_and_takes_a_known_memory(process: RpcProcess, item: bytes) -> None:
    n = (MOST_ITEMS - 10) // (3 if len(item) == 5 else 1)
    n = min(n, (MOST_BYTES - 100) // len(item))
    good = Client(process.port)
    send(good, HEAD + b"\xdd" + struct.pack(">I", n) + item * n)
    assert good.join(1) == n
    assert process.most_bytes() < 256 * MIB


def test_halves_of_messages_of_many_clients_take_a_limited_memory(process: RpcProcess) -> None:
    good = Client(process.port)
    bad = [Client(process.port) for _ in range(24)]
    half = HEAD + b"\xc6" + struct.pack(">I", MOST_BYTES - 100) + bytes(MOST_BYTES - 200)
    for client in bad:
        send(client, half)
    assert good.call("ping") is True
    assert process.most_bytes() < 256 * MIB
    assert Client(process.port).call("ping") is True


def test_a_process_without_descriptors_says_so_once_and_recovers() -> None:
    with RpcProcess() as process:
        process.limit_descriptors(64)
        clients = [Client(process.port) for _ in range(100)]  # beyond the limit, the system holds them
        assert clients[0].call("ping") is True
        last = clients.pop()
        waiting = last.send("ping")
        for client in clients:
            client.close()
        assert last.join(waiting) is True
        text = process.end()
    assert "Traceback" not in text
    assert len(text.splitlines()) == 1, text
    assert "a new client waits, because this process cannot open more files" in text


@contextlib.contextmanager
def serving() -> Iterator[tuple[RpcServer, int, list[str]]]:
    """Serve `ping` and `zeros` in a thread."""
    log: list[str] = []
    table = MethodTable([method("ping", lambda: True), method("zeros", bytes, Parameter("n", COUNT))])
    server, loop, ready = RpcServer(table, log.append), asyncio.new_event_loop(), threading.Event()
    ports: list[int] = []

    async def serve() -> None:
        ports.append(await server.start("127.0.0.1", 0))
        ready.set()
        await stop.wait()
        await server.stop()

    stop = asyncio.Event()
    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    assert ready.wait(PATIENCE_S)
    try:
        yield server, ports[0], log
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(PATIENCE_S)
        loop.close()


def test_clients_that_never_call_make_room_for_those_that_do() -> None:
    with serving() as (server, port, log):
        good = Client(port)
        assert good.call("ping") is True
        silent = [Client(port) for _ in range(MOST_CLIENTS + 50)]
        newest = Client(port)
        assert newest.call("ping") is True
        assert good.call("ping") is True
        assert len(server._open) <= MOST_CLIENTS
        assert silent[0].is_closed()
        assert len(log) == 1
        assert f"there are {MOST_CLIENTS} clients, as many as there may be" in log[0]
        for client in silent:
            client.close()


def test_when_all_have_called_the_newest_is_dropped() -> None:
    with serving() as (server, port, _):
        clients = [Client(port) for _ in range(MOST_CLIENTS)]
        assert all(client.call("ping") for client in clients)
        assert Client(port).is_closed()
        assert len(server._open) == MOST_CLIENTS
        assert all(client.call("ping") for client in clients)
        clients.pop().close()
        until(lambda: len(server._open) < MOST_CLIENTS, "a free place")
        assert Client(port).call("ping") is True


def test_the_largest_halves_of_messages_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rpc_server, "MOST_UNANSWERED_BYTES", 8 * MIB)
    with serving() as (server, port, log):
        good = Client(port)
        send(good, HEAD + b"\xc5\xff\xff" + bytes(1000))
        bad = [Client(port) for _ in range(12)]
        for client in bad:
            send(client, HEAD + b"\xc6" + struct.pack(">I", 2 * MIB) + bytes(MIB))
        until(lambda: log, "a dropped client")
        assert Client(port).call("ping") is True
        assert sum(each.unanswered_bytes for each in server._open) <= 8 * MIB
        assert log == [f"all clients have begun {8 * MIB} bytes of messages: the largest are dropped"]
        send(good, bytes(0xFFFF - 1000))
        with pytest.raises(RpcFailed, match="could not find function 'count'"):
            good.join(1)


def test_replies_that_nobody_reads_take_a_limited_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rpc_server, "MOST_UNREAD_BYTES", 32 * MIB)
    with serving() as (server, port, log):
        lazy = [Client(port) for _ in range(5)]
        for client in lazy:
            client.send("zeros", 12 * MIB)
        good = Client(port)
        assert good.call("zeros", 30 * MIB) == bytes(30 * MIB)
        assert sum(each.unread_bytes for each in server._open) <= 32 * MIB
        assert log == [f"all clients have {32 * MIB} bytes of replies to read: the slowest readers are dropped"]
        assert Client(port).call("ping") is True


def test_a_client_that_leaves_at_any_byte_is_forgotten() -> None:
    message = msgpack.packb([0, 1, "ping", [{"x_val": 1.0}, [1, 2, "abc"], b"\x00" * 300]])
    with serving() as (server, port, log):
        for end in range(0, len(message), 3):
            client = Client(port)
            client.socket.sendall(message[:end])
            if end % 2:  # a reset in place of an orderly end
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()
        assert Client(port).call("ping") is True
        until(lambda: len(server._open) <= 1, "an end of all connections")
        assert not log


def test_values_in_messages_of_errors_are_short() -> None:
    deep: list[object] = []
    for _ in range(50):
        deep = [deep, "x" * 1000]
    with serving() as (_, port, log):
        client = Client(port)
        for value in (deep, "\udcff" * 1000, list(range(1000)), {str(i): deep for i in range(100)}, (1 << 64) - 1):
            client.socket.sendall(msgpack.packb([0, 1, "zeros", [value]], unicode_errors="surrogateescape"))
            with pytest.raises(RpcFailed, match="expected an integer") as refused:
                client.join(1)
            assert len(str(refused.value)) < 300
        assert not [line for line in log if "defect" in line]
