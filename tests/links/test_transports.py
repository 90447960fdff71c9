"""Bytes over every kind of wire: whole, in order, without deadlock, and with a named error at the end."""

import os
import socket
import threading
import time

import pytest

from firmware_bridge.transports.loopback import LoopbackTransport
from firmware_bridge.transports.pty import PtyTransport
from firmware_bridge.transports.serial import SerialTransport, check_port
from firmware_bridge.transports.tcp import TcpClient, TcpServer
from firmware_bridge.transports.udp import UdpTransport
from signals.errors import LinkClosed, LinkError, PortBusy, PortNotFound
from tests.worlds.patience import PATIENCE_S

EVERY_BYTE = bytes(range(256))


@pytest.fixture
def pty_pair():
    near = PtyTransport()
    near.open()
    far = SerialTransport(near.far_path)
    far.open()
    yield near, far
    far.close()
    near.close()


@pytest.fixture
def tcp_pair():
    server = TcpServer(0)
    server.open()
    client = TcpClient(server.port)
    client.open()
    yield server, client
    client.close()
    server.close()


def read_exactly(transport, count, limit_s=PATIENCE_S):
    data = b""
    deadline = time.monotonic() + limit_s
    while len(data) < count and time.monotonic() < deadline:
        data += transport.read(0.1)
    return data


@pytest.fixture(params=["pty", "tcp"])
def pair(request):
    return request.getfixturevalue(f"{request.param}_pair")


def test_every_byte_value_both_ways(pair):
    near, far = pair
    far.write(EVERY_BYTE)
    assert read_exactly(near, 256) == EVERY_BYTE
    near.write(EVERY_BYTE)
    assert read_exactly(far, 256) == EVERY_BYTE
    assert near.fileno() is not None
    assert near.read(0.0) == near.read(0.01) == b""


def test_two_long_writers_do_not_deadlock(pair):
    near, far = pair
    size = 3_000_000 if isinstance(near, TcpServer) else 200_000
    if isinstance(near, TcpServer):
        near.read(0.5)  # accepts the client
    blob = os.urandom(size)
    got = {}

    def other():
        far.write(blob)
        got["far"] = read_exactly(far, size)

    thread = threading.Thread(target=other)
    thread.start()
    near.write(blob)
    got["near"] = read_exactly(near, size)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert got["near"] == got["far"] == blob


def test_a_far_side_that_does_not_read_is_named(pty_pair):
    near, _ = pty_pair
    near._stream._write_stall_s = 0.05
    with pytest.raises(LinkClosed, match="taken no byte"):
        near.write(bytes(1_000_000))


def test_hang_up_after_the_last_byte(pair):
    near, far = pair
    far.write(b"last words")
    assert read_exactly(near, 10) == b"last words"
    far.close()
    with pytest.raises(LinkClosed):
        read_exactly(near, 1)


def test_near_side_closing_is_seen_by_the_far_side(pair):
    near, far = pair
    far.write(b"x")
    assert read_exactly(near, 1) == b"x"
    near.close()
    with pytest.raises(LinkClosed):
        read_exactly(far, 1)


def test_closing_twice_and_using_a_closed_wire(pair):
    for transport in pair:
        transport.close()
        transport.close()
        assert transport.fileno() is None
        with pytest.raises(LinkClosed):
            transport.read(0.0)
        with pytest.raises(LinkClosed):
            transport.write(b"x")


def test_missing_port_lists_the_existing_ones():
    with pytest.raises(PortNotFound, match=r"/dev/ttyNOPE.*Ports here"):
        SerialTransport("/dev/ttyNOPE").open()


def test_a_busy_port_is_named(pty_pair):
    near, _ = pty_pair
    with pytest.raises(PortBusy, match="another program"):
        SerialTransport(near.far_path).open()


def test_a_file_that_is_no_serial_port_is_named(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    for path in (str(file), str(tmp_path), "/dev/null"):
        with pytest.raises(LinkError, match="not a serial port"):
            SerialTransport(path).open()
        with pytest.raises(LinkError, match="not a serial port"):
            check_port(path)


def test_a_port_is_checked_without_opening_it(pty_pair):
    near, _ = pty_pair
    check_port(near.far_path)  # held by another program
    with pytest.raises(PortNotFound, match=r"/dev/ttyNOPE.*Ports here"):
        check_port("/dev/ttyNOPE")


def test_an_impossible_baud_rate_is_named():
    near = PtyTransport()
    near.open()
    try:
        with pytest.raises(LinkError, match="baud"):
            SerialTransport(near.far_path, baud=-5).open()
    finally:
        near.close()


@pytest.mark.parametrize("made", [PtyTransport, lambda: TcpServer(0)])
def test_a_wire_waits_for_a_far_side_that_has_not_connected_yet(made):
    near = made()
    near.open()
    try:
        assert near.read(0.01) == b""
        if isinstance(near, TcpServer):
            with pytest.raises(LinkClosed, match="no client"):
                near.write(b"x")
            with pytest.raises(PortBusy, match=str(near.port)):
                TcpServer(near.port).open()
            near.close()
            with pytest.raises(PortNotFound, match="started"):
                TcpClient(near.port).open()
    finally:
        near.close()


@pytest.mark.parametrize("kind", [TcpServer, UdpTransport])
def test_a_foreign_host_is_refused(kind):
    with pytest.raises(PortNotFound):
        kind(0, host="203.0.113.1").open()


def test_udp_answers_the_last_sender():
    server = UdpTransport()
    server.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        with pytest.raises(LinkClosed, match="no datagram has come"):
            server.write(b"x")
        client.settimeout(PATIENCE_S)
        client.sendto(b"hello", ("127.0.0.1", server.port))
        assert server.read(PATIENCE_S) == b"hello"
        assert server.read(0.0) == b""
        server.write(b"you too")
        assert client.recv(100) == b"you too"
        with pytest.raises(LinkError, match="cannot send"):
            server.write(bytes(70_000))
        with pytest.raises(PortBusy):
            UdpTransport(server.port).open()
    server.close()
    with pytest.raises(LinkClosed):
        server.read(0.0)


class Echo:
    def boot(self) -> bytes:
        return b"hello"

    def feed(self, data: bytes) -> bytes:
        if data == b"die":
            raise ZeroDivisionError("diverged")
        return data[::-1]


def test_loopback():
    wire = LoopbackTransport(Echo())
    with pytest.raises(LinkClosed):
        wire.write(b"x")
    wire.open()
    assert wire.read(0.0) == b"hello"
    wire.write(b"abc")
    wire.write(b"def")
    assert wire.read(10.0) == b"cbafed"
    assert wire.read(10.0) == b""
    wire.close()
    with pytest.raises(LinkClosed):
        wire.read(0.0)


def test_death_of_a_loopback_peer_is_a_hang_up_after_its_last_output():
    wire = LoopbackTransport(Echo(), crashes=(ZeroDivisionError,))
    wire.open()
    wire.write(b"abc")
    wire.write(b"die")
    assert wire.read(0.0) == b"hellocba"
    with pytest.raises(LinkClosed, match=r"died .ZeroDivisionError: diverged"):
        wire.read(0.0)
    unexpected = LoopbackTransport(Echo())
    unexpected.open()
    with pytest.raises(ZeroDivisionError):
        unexpected.write(b"die")
