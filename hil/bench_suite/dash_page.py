"""A page without a browser, as a process of its own: takes every update as fast as it comes.

    python -m hil.bench_suite.dash_page HOST:PORT STREAM...

It writes one line of JSON when the server hangs up: updates, bytes, frames, and seconds from the first to the last.

A page is on somebody's desk, not on the bench: this one should take next to nothing of the processor that the run and
the server are measured on. So it reads whole messages from a plain socket into one buffer and decodes nothing but their
lengths; of the WebSocket protocol (RFC 6455) it knows what this server says.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import sys
import time
from collections.abc import Sequence

_TEXT, _BINARY, _CLOSE, _PING, _PONG = 1, 2, 8, 9, 10
_MOST_BYTES = 64 << 20
_FRAME_MARK = b'"length":'


def framed(opcode: int, payload: bytes) -> bytes:
    """A frame of a client, of less than 64 KiB; masked, as it must be, with a mask that leaves it as it is."""
    size = len(payload)
    length = bytes([0x80 | size]) if size < 126 else bytes([0x80 | 126]) + struct.pack(">H", size)
    return bytes([0x80 | opcode]) + length + bytes(4) + payload


class _Gone(Exception):
    """The server hung up."""


class _Wire:
    """A socket that is read a frame at a time, into memory that is used again."""

    def __init__(self, host: str) -> None:
        name, _, port = host.rpartition(":")
        self._socket = socket.create_connection((name, int(port)))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer = bytearray(1 << 16)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            "GET /live HTTP/1.1",
            f"Host: {host}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
        ]
        self._socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):  # the server says nothing more before it is spoken to
            answer += self._some(1).tobytes()
        if not answer.startswith(b"HTTP/1.1 101"):
            raise _Gone

    def say(self, frame: bytes) -> None:
        try:
            self._socket.sendall(frame)
        except OSError as error:
            raise _Gone from error

    def frame(self) -> tuple[int, memoryview]:
        """Opcode and payload, which is there until the next one is read."""
        first, second = self._some(2)
        size = second & 127
        if size > 125:
            size = int.from_bytes(self._some(2 if size == 126 else 8), "big")
        if not first & 0x80 or second & 0x80 or size > _MOST_BYTES:
            raise _Gone  # in pieces, or masked: nothing that this server sends
        return first & 15, self._some(size)

    def _some(self, size: int) -> memoryview:
        if size > len(self._buffer):
            self._buffer = bytearray(2 * size)
        whole = memoryview(self._buffer)[:size]
        at = 0
        while at < size:
            try:
                # All of it in one call: a process that waits in the system costs nothing until its message is whole.
                got = self._socket.recv_into(whole[at:], size - at, socket.MSG_WAITALL)
            except OSError as error:
                raise _Gone from error
            if not got:
                raise _Gone
            at += got
        return whole


def follow(host: str, streams: Sequence[str]) -> dict[str, float]:
    """Until the server is gone."""
    updates, size, frames, began_s, last_s = 0, 0, 0, 0.0, 0.0
    asking = framed(_TEXT, b'{"kind":"next"}')
    try:
        wire = _Wire(host)
        wire.say(framed(_TEXT, json.dumps({"kind": "streams", "streams": list(streams)}).encode()))
        wire.say(asking)
        while True:
            opcode, data = wire.frame()
            if opcode == _PING:
                wire.say(framed(_PONG, data.tobytes()))
            elif opcode == _CLOSE:
                break
            elif opcode == _BINARY:
                last_s = time.monotonic()
                began_s = began_s or last_s
                updates += 1
                size += len(data)
                frames += data[: 4 + int.from_bytes(data[:4], "little")].tobytes().count(_FRAME_MARK)
                wire.say(asking)
    except _Gone:
        pass
    return {"updates": updates, "bytes": size, "frames": frames, "seconds": last_s - began_s}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(follow(sys.argv[1], sys.argv[2:])) + "\n")
