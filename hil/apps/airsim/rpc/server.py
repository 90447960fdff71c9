"""TCP server of the RPC methods."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import time
from typing import Any

from hil.apps.airsim.rpc.connection import Connection, Log
from hil.apps.airsim.rpc.methods import Caller, MethodTable
from signals.errors import ConfigError

MOST_CLIENTS = 256
MOST_UNANSWERED_BYTES = 128 << 20  # of all clients together, before they are answered
MOST_UNREAD_BYTES = 1 << 30  # of replies to all clients together
_TOLD_AGAIN_S = 60.0  # least time between two lines about the same limit
_NO_DESCRIPTOR = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})


class RpcServer:
    """Server of one method table. `digest` covers all replies in their order; ports of clients have no influence."""

    def __init__(self, methods: MethodTable, log: Log, *, digest: bool = False) -> None:
        self.methods = methods
        self.clients = 0  # connections so far
        self.replies = 0
        self.digest = hashlib.sha256() if digest else None
        self._log = log
        self._open: dict[Connection, None] = {}  # in the order of their beginning
        self._server: asyncio.Server | None = None
        self._told_s: dict[str, float] = {}  # when a limit was told last

    async def start(self, host: str, port: int) -> int:
        """Listen, and return the port. Errors of the loop go to the log from then on. Raises ConfigError."""
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._failed)
        try:
            self._server = await loop.create_server(self._connection, host, port, backlog=128)
        except OSError as error:
            hint = "end the program that holds it, or choose another with --port"
            raise ConfigError.at(f"{host}:{port}", f"cannot listen: {error.strerror or error}", hint) from None
        chosen: int = self._server.sockets[0].getsockname()[1]
        return chosen

    async def stop(self) -> None:
        """Close the port and all connections."""
        if self._server is not None:
            self._server.close()
        for connection in list(self._open):
            connection.close()
        await asyncio.sleep(0)

    def _connection(self) -> Connection:
        connection = Connection(self.clients, self.methods, self._log, self)
        self.clients += 1
        return connection

    def made(self, connection: Connection) -> None:
        """Keep a new client. Of too many, the first one that has never called is dropped, or the new one."""
        self._open[connection] = None
        if len(self._open) > MOST_CLIENTS:
            silent = next(each for each in self._open if not each.has_called)
            self._tell(
                f"there are {MOST_CLIENTS} clients, as many as there may be: the new one, or one that never called, is "
                "dropped"
            )
            self._drop(silent)

    def gone(self, connection: Connection) -> None:
        """Forget a client."""
        self._open.pop(connection, None)

    def grown(self) -> None:
        """Drop clients while all together keep too much memory: with long messages, or by reading no replies."""
        unanswered = {each: each.unanswered_bytes for each in self._open}
        unread = {each: each.unread_bytes for each in self._open}
        while sum(unanswered.values()) > MOST_UNANSWERED_BYTES:
            worst = max(unanswered, key=unanswered.__getitem__)
            del unanswered[worst]
            self._tell(f"all clients have begun {MOST_UNANSWERED_BYTES} bytes of messages: the largest are dropped")
            self._drop(worst)
        while len(unread) > 1 and sum(unread.values()) > MOST_UNREAD_BYTES:
            worst = min(unread, key=lambda each: each.unread_since_s)
            del unread[worst]
            self._tell(
                f"all clients have {MOST_UNREAD_BYTES} bytes of replies to read: the slowest readers are dropped"
            )
            self._drop(worst)

    def replied(self, caller: Caller, name: str, body: bytes) -> None:
        """Count a reply."""
        self.replies += 1
        digest = self.digest
        if digest is None:
            return
        digest.update(f"{caller.number} {name} {len(body)} ".encode("utf-8", "surrogateescape"))
        digest.update(body)

    def _drop(self, connection: Connection) -> None:
        self._open.pop(connection, None)
        connection.drop()

    def _failed(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log an error that no call raises. Without a free descriptor asyncio tries again after a second."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in _NO_DESCRIPTOR and "socket" in context:
            self._tell(
                f"a new client waits, because this process cannot open more files: {error.strerror}; see `ulimit -n`"
            )
        else:
            text = type(error).__name__ if error is not None else "error"
            self._log(f"{context['message']}: {text}: {error} (a defect of the server)")

    def _tell(self, text: str) -> None:
        """Log a limit, and no more of it for a while."""
        now_s = time.monotonic()
        if now_s - self._told_s.get(text, -_TOLD_AGAIN_S) >= _TOLD_AGAIN_S:
            self._told_s[text] = now_s
            self._log(text)
