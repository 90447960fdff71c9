"""Connection of one client: decodes its messages within limits, calls the methods, and writes the replies.

    request       [0, id, method, params]   ->   reply [1, id, error, result]
    notification  [2, method, params]       ->   no reply

A message of another form, or bytes that are no MessagePack, cannot be answered by an id: the connection is closed.
Replies of slow methods (`Pending`) follow when they are there, so that a client may have several calls at once.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Any

import msgpack

from hil.apps.airsim.rpc.methods import Caller, MethodTable, Pending, RpcError, refused
from hil.apps.airsim.rpc.packing import pack

MOST_BYTES = 8 << 20  # of one message: a path of 90 000 points
_MOST_ITEMS = 1 << 20  # of one array or map
_MOST_UNANSWERED = 1000
_TURN_NS = 1_000_000  # of one client, before others are served
_REQUEST, _REPLY, _NOTIFICATION = 0, 1, 2

Log = Callable[[str], None]
Observer = Callable[[Caller, str, bytes], None]  # (client, method, packed reply) in the order of the replies


class Connection(asyncio.Protocol):
    """One client of a server. `gone` is called once, when the connection is over."""

    def __init__(
        self, number: int, methods: MethodTable, log: Log, *, replied: Observer, gone: Callable[[Connection], None]
    ) -> None:
        self.caller = Caller(number, "?")
        self._methods, self._log, self._replied, self._gone = methods, log, replied, gone
        self._unpacker = msgpack.Unpacker(
            raw=False,
            strict_map_key=False,
            unicode_errors="surrogateescape",
            max_buffer_size=MOST_BYTES,
            max_array_len=_MOST_ITEMS,
            max_map_len=_MOST_ITEMS,
            max_str_len=MOST_BYTES,
            max_bin_len=MOST_BYTES,
            max_ext_len=0,
        )
        self._transport: asyncio.Transport | None = None
        self._unanswered = 0
        self._waits = False  # the client does not read its replies
        self._drains = False  # messages are left for the next turn of the loop
        self._held: Any = None  # message that waits for the world
        self._told: set[str] = set()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept the client."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        peer = transport.get_extra_info("peername")
        self.caller = self.caller._replace(address=f"{peer[0]}:{peer[1]}" if peer else "?")
        endpoint = transport.get_extra_info("socket")
        if endpoint is not None and endpoint.family in (socket.AF_INET, socket.AF_INET6):
            endpoint.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """Forget the client; its pending calls go on without it."""
        self._transport = None
        self._gone(self)

    def pause_writing(self) -> None:
        """Read nothing more from a client that does not read its replies."""
        self._waits = True
        self._set_reading()

    def resume_writing(self) -> None:
        """Read again."""
        self._waits = False
        self._drain()

    def data_received(self, data: bytes) -> None:
        """Answer all complete messages, others' in between if it takes long."""
        try:
            self._unpacker.feed(data)
        except (msgpack.BufferFull, MemoryError):
            self._close(f"a message of more than {MOST_BYTES} bytes")
        else:
            if not self._drains and self._held is None:
                self._drain()

    def _drain(self) -> None:
        self._drains = False
        held, self._held = self._held, None
        end_ns = time.perf_counter_ns() + _TURN_NS
        try:
            while not self._waits and self._transport is not None and not self._transport.is_closing():
                try:
                    message = self._unpacker.unpack() if held is None else held
                except msgpack.OutOfData:
                    break
                held = None
                if self._must_wait(message):
                    self._held = message
                    break
                self._answer(message)
                if time.perf_counter_ns() > end_ns:
                    self._drains = True
                    asyncio.get_running_loop().call_soon(self._drain)
                    break
        except (msgpack.UnpackException, ValueError, TypeError, OverflowError, MemoryError, RecursionError) as error:
            self._close(f"bytes that are no MessagePack-RPC ({str(error)[:100] or type(error).__name__})")
        self._set_reading()

    def _set_reading(self) -> None:
        """Read only from a client whose messages are all answered and whose replies are read."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if self._waits or self._drains or self._held is not None:
            transport.pause_reading()
        else:
            transport.resume_reading()

    def close(self) -> None:
        """Close the connection after the replies written so far."""
        if self._transport is not None:
            self._transport.close()

    def _close(self, reason: str) -> None:
        self._log(f"{self.caller.address}: {reason}; the connection was closed")
        self.close()

    def _must_wait(self, message: Any) -> bool:
        """Return True if a message waits for the world; this client is read on then."""
        lock = self._methods.lock
        if lock is None or not lock.held or not isinstance(message, list) or len(message) < 3:
            return False
        name = message[-2]
        if not self._methods.waits(name.decode("utf-8", "surrogateescape") if isinstance(name, bytes) else str(name)):
            return False
        lock.then(self._drain)
        return True

    def _answer(self, message: Any) -> None:
        if not isinstance(message, list) or not message:
            self._close(f"a message that is no array but a {type(message).__name__}")
            return
        kind = message[0]
        if kind == _REPLY and not isinstance(kind, bool) and len(message) == 4:
            return  # the server calls nobody, so there is nothing to do with a reply
        if kind == _REQUEST and not isinstance(kind, bool) and len(message) == 4:
            _, request, name, values = message
        elif kind == _NOTIFICATION and not isinstance(kind, bool) and len(message) == 3:
            request, (_, name, values) = None, message
        else:
            self._close("a message that is neither [0, id, method, params] nor [2, method, params]")
            return
        wants_reply = kind == _REQUEST
        if wants_reply and (isinstance(request, bool) or not isinstance(request, int) or not 0 <= request < 1 << 32):
            self._close("a request whose id is no 32-bit number")
            return
        if isinstance(name, bytes):
            name = name.decode("utf-8", "surrogateescape")
        if not isinstance(name, str) or not isinstance(values, list):
            self._close("a request whose method is no text or whose params are no array")
            return
        self._call(request if wants_reply else None, name, values)

    def _call(self, request: int | None, name: str, values: list[Any]) -> None:
        try:
            if self._unanswered >= _MOST_UNANSWERED:
                raise RpcError(
                    f"this client has {_MOST_UNANSWERED} calls that are not over; join some of them before the next"
                )
            result = self._methods.call(name, values)
        except RpcError as error:
            self._tell(name, str(error))
            self._reply(request, name, str(error), None)
        except Exception as defect:  # noqa: BLE001 (one client's call ends no other's)
            text = f"{type(defect).__name__}: {defect} (a defect of the server)"
            self._log(f"{name}: {text}")
            self._reply(request, name, str(refused(name, len(values), text)), None)
        else:
            if isinstance(result, Pending):
                self._unanswered += 1
                result.then(lambda value: self._reply_later(request, name, value))
            else:
                self._reply(request, name, None, result)

    def _tell(self, name: str, text: str) -> None:
        """Log an unknown name or a refused call, each text once per connection."""
        key = f"{name[:80]}: {text[:200]}"
        if key not in self._told and len(self._told) < 100:
            self._told.add(key)
            self._log(f"{self.caller.address}: {text}")

    def _reply_later(self, request: int | None, name: str, value: Any) -> None:
        self._unanswered -= 1
        if isinstance(value, RpcError):
            self._tell(name, str(value))
            self._reply(request, name, str(value), None)
        else:
            self._reply(request, name, None, value)

    def _reply(self, request: int | None, name: str, error: str | None, result: Any) -> None:
        try:
            body = pack(error) + pack(result)
        except Exception as defect:  # noqa: BLE001 (a result of a wrong type ends neither connection nor simulation)
            text = f"rpclib: function '{name}' returned what no reply can hold: {defect} (a defect of the server)"
            self._log(text)
            body = pack(text) + pack(None)
        self._replied(self.caller, name, body)
        if request is not None and self._transport is not None and not self._transport.is_closing():
            self._transport.write(b"\x94\x01" + pack(request) + body)
