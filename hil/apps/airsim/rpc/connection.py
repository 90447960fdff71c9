"""Connection of one client: decodes its messages within limits, calls the methods, and writes the replies.

    request       [0, id, method, params]   ->   reply [1, id, error, result]
    notification  [2, method, params]       ->   no reply

A message of another form, or bytes that are not MessagePack, cannot be answered by an id: the connection is closed.
Replies of slow methods (`Pending`) follow when they are there, so that a client may have several calls at once.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from math import inf
from typing import Any, Protocol

import msgpack

from hil.apps.airsim.rpc.framing import Framer, TooLarge
from hil.apps.airsim.rpc.methods import Caller, MethodTable, Pending, RpcError, refused
from hil.apps.airsim.rpc.packing import pack

_MOST_UNANSWERED = 1000
_TURN_NS = 1_000_000  # of one client, before others are served
_FEW_BYTES = 1 << 16  # that a connection keeps without asking if they are too many together with others'
_REQUEST, _REPLY, _NOTIFICATION = 0, 1, 2

Log = Callable[[str], None]


class Owner(Protocol):
    """Server that accepts connections (`hil.apps.airsim.rpc.server.RpcServer`)."""

    def made(self, connection: Connection) -> None:
        """Called once, when the client is there."""
        ...

    def grown(self) -> None:
        """Called when a connection keeps more bytes than before."""
        ...

    def replied(self, caller: Caller, name: str, body: bytes) -> None:
        """Called with (client, method, packed reply) in the order of the replies."""
        ...

    def gone(self, connection: Connection) -> None:
        """Called once, when the connection is over."""
        ...


class Connection(asyncio.Protocol):
    """One client of a server."""

    def __init__(self, number: int, methods: MethodTable, log: Log, owner: Owner) -> None:
        self.caller = Caller(number, "?")
        self.has_called = False
        self._methods, self._log, self._owner = methods, log, owner
        self._framer = Framer()
        self._transport: asyncio.Transport | None = None
        self._unanswered = 0
        self.unread_since_s = inf  # until then the client has read its replies
        self._drains = False  # messages are left for the next turn of the loop
        self._held: bytes | None = None  # message that waits for the world
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
        self._owner.made(self)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """Forget the client; its pending calls go on without it."""
        self._transport = None
        self._framer = Framer()
        self._held = None
        self._owner.gone(self)

    def pause_writing(self) -> None:
        """Read nothing more from a client that does not read its replies."""
        self.unread_since_s = time.monotonic()
        self._set_reading()

    def resume_writing(self) -> None:
        """Read again."""
        self.unread_since_s = inf
        self._drain()

    def data_received(self, data: bytes) -> None:
        """Answer all complete messages, others' in between if it takes long."""
        self._framer.feed(data)
        if not self._drains and self._held is None:
            self._drain()
        if len(self._framer) > _FEW_BYTES:
            self._owner.grown()

    @property
    def unanswered_bytes(self) -> int:
        """Bytes of messages that are not complete or wait for their turn."""
        return len(self._framer) + (0 if self._held is None else len(self._held))

    @property
    def unread_bytes(self) -> int:
        """Bytes of replies that the client has not read."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    def _drain(self) -> None:
        self._drains = False
        held, self._held = self._held, None
        end_ns = time.perf_counter_ns() + _TURN_NS
        try:
            while self.unread_since_s == inf and self._transport is not None and not self._transport.is_closing():
                data = self._framer.next() if held is None else held
                held = None
                if data is None:
                    break
                message = _unpacked(data)
                if self._must_wait(message):
                    self._held = data
                    break
                self._answer(message)
                del message  # it may need a hundred times the bytes
                if time.perf_counter_ns() > end_ns:
                    self._drains = True
                    asyncio.get_running_loop().call_soon(self._drain)
                    break
        except TooLarge as error:
            self._close(str(error))
        except (msgpack.UnpackException, ValueError, TypeError, OverflowError, MemoryError, RecursionError) as error:
            self._close(f"bytes that are not MessagePack-RPC ({str(error)[:100] or type(error).__name__})")
        self._set_reading()

    def _set_reading(self) -> None:
        """Read only from a client whose messages are all answered and whose replies are read."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if self.unread_since_s < inf or self._drains or self._held is not None:
            transport.pause_reading()
        else:
            transport.resume_reading()

    def close(self) -> None:
        """Close the connection after the replies written so far."""
        if self._transport is not None:
            self._transport.close()

    def drop(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

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
            self._close(f"expected an array, got a {type(message).__name__}")
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
            self._close("a request whose id is not a 32-bit number")
            return
        if isinstance(name, bytes):
            name = name.decode("utf-8", "surrogateescape")
        if not isinstance(name, str) or not isinstance(values, list):
            self._close("a request whose method is not text or whose params are not an array")
            return
        self._call(request if wants_reply else None, name, values)

    def _call(self, request: int | None, name: str, values: list[Any]) -> None:
        self.has_called = True
        try:
            if self._unanswered >= _MOST_UNANSWERED:
                raise RpcError(
                    f"this client has {_MOST_UNANSWERED} calls that are not over; join some of them before the next"
                )
            result = self._methods.call(name, values)
        except RpcError as error:
            self._tell(name, error)
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

    def _tell(self, name: str, error: RpcError) -> None:
        """Log an unknown name or a refused call, each text once per connection."""
        text = self._methods.refuse(name, error)
        key = f"{name[:80]}: {text[:200]}"
        if key not in self._told and len(self._told) < 100:
            self._told.add(key)
            self._log(f"{self.caller.address}: {text}")

    def _reply_later(self, request: int | None, name: str, value: Any) -> None:
        self._unanswered -= 1
        if isinstance(value, RpcError):
            self._tell(name, value)
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
        self._owner.replied(self.caller, name, body)
        if request is not None and self._transport is not None and not self._transport.is_closing():
            self._transport.write(b"\x94\x01" + pack(request) + body)
            if self._transport.get_write_buffer_size() > _FEW_BYTES:
                self._owner.grown()


def _unpacked(data: bytes) -> Any:
    return msgpack.unpackb(data, raw=False, strict_map_key=False, unicode_errors="surrogateescape", max_ext_len=0)
