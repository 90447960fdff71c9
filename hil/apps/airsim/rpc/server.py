"""TCP server of the RPC methods."""

from __future__ import annotations

import asyncio
import hashlib

from hil.apps.airsim.rpc.connection import Connection, Log
from hil.apps.airsim.rpc.methods import Caller, MethodTable
from signals.errors import ConfigError, Problem

MOST_CLIENTS = 256


class RpcServer:
    """Server of one method table. `digest` covers all replies in their order; ports of clients have no influence."""

    def __init__(self, methods: MethodTable, log: Log, *, digest: bool = False) -> None:
        self.methods = methods
        self.clients = 0  # connections so far
        self.replies = 0
        self.digest = hashlib.sha256() if digest else None
        self._log = log
        self._open: set[Connection] = set()
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int) -> int:
        """Listen, and return the port. Raises ConfigError."""
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(self._connection, host, port, backlog=128)
        except OSError as error:
            hint = "end the program that holds it, or choose another with --port"
            raise ConfigError([Problem(f"{host}:{port}", f"cannot listen: {error.strerror or error}", hint)]) from None
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
        connection = Connection(self.clients, self.methods, self._log, replied=self._count, gone=self._open.discard)
        self.clients += 1
        self._open.add(connection)
        if len(self._open) > MOST_CLIENTS:
            self._log(f"more than {MOST_CLIENTS} clients: the newest was closed")
            asyncio.get_running_loop().call_soon(connection.close)
        return connection

    def _count(self, caller: Caller, name: str, body: bytes) -> None:
        self.replies += 1
        digest = self.digest
        if digest is None:
            return
        digest.update(f"{caller.number} {name} {len(body)} ".encode("utf-8", "surrogateescape"))
        digest.update(body)
