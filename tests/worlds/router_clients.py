"""Clients of the router on real sockets, and the frames they exchange with it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.router.router import Router
from tests.worlds.patience import PATIENCE_S


def raw(encoder: FrameEncoder, name: str, *values: Any) -> bytes:
    message = message_class(name)(*values)
    return encoder.frame(message.MSGID, pack(message))


def framed(data: bytes) -> Frame:
    (frame,) = FrameParser().feed(data)
    return frame


def heartbeat(encoder: FrameEncoder) -> bytes:
    return raw(encoder, "HEARTBEAT", 6, 8, 0, 0, 4, 3)


def command(encoder: FrameEncoder, system: int, component: int, number: int = 400) -> bytes:
    return raw(encoder, "COMMAND_LONG", system, component, number, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def address_of(router: Router, endpoint: int = 0) -> tuple[str, int]:
    """Return the address that clients of this endpoint send to."""
    return router._ports[endpoint].address


class UdpClient:
    """A client that sends from a UDP port of its own."""

    def __init__(self, sysid: int = 245, compid: int = 190) -> None:
        self.encoder = FrameEncoder(sysid, compid)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.address = self.socket.getsockname()
        self.parser = FrameParser()
        self.heard: list[Frame] = []

    def say(self, data: bytes, to: tuple[str, int]) -> None:
        self.socket.sendto(data, to)

    def hear(self) -> list[Frame]:
        """Return everything that has arrived since the beginning."""
        while True:
            try:
                self.heard += self.parser.feed(self.socket.recv(65536))
            except BlockingIOError:
                return self.heard

    def close(self) -> None:
        self.socket.close()


class TcpClient(UdpClient):
    """A client that connects by TCP."""

    def __init__(self, to: tuple[str, int], sysid: int = 245, compid: int = 190, receive_buffer: int = 0) -> None:
        self.encoder = FrameEncoder(sysid, compid)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.connect(to)
        self.socket.setblocking(False)
        self.parser = FrameParser()
        self.heard = []

    def say(self, data: bytes, to: tuple[str, int] | None = None) -> None:
        self.socket.sendall(data)

    def hear(self) -> list[Frame]:
        while True:
            try:
                data = self.socket.recv(65536)
            except BlockingIOError:
                return self.heard
            if not data:
                return self.heard
            self.heard += self.parser.feed(data)


class Clock:
    """A wall clock that the test advances."""

    def __init__(self) -> None:
        self.ns = 10**9

    def __call__(self) -> int:
        return self.ns


def until(router: Router, done: Callable[[bytes], bool], t_ns: int = 0, limit_s: float = PATIENCE_S) -> bytes:
    """Collect until `done` is true of everything collected: loopback takes a moment."""
    data = b""
    deadline = time.monotonic() + limit_s
    while True:
        data += router.collect(t_ns)
        if done(data):
            return data
        assert time.monotonic() < deadline, f"only {len(data)} bytes came"
        time.sleep(0.001)


@pytest.fixture
def client() -> Iterator[UdpClient]:
    """A client, closed at the end."""
    client = UdpClient()
    yield client
    client.close()
