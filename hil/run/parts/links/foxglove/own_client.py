"""The bench as a client of its own server: so the SDK's threads tell all clients that parameters have changed.

The SDK's function for that, `publish_parameter_values`, must not be called from Python. It waits for a lock of the SDK
and keeps the interpreter's lock (GIL) meanwhile; a thread of the SDK that takes up or ends a client's subscription of
parameters holds the SDK's lock and waits for the interpreter's, to tell the listener. Then nothing in the process moves
again, signal handlers included (foxglove-sdk 0.30.3).

When a client sets parameters, the SDK sends what the listener returns to all subscribers, without the interpreter's
lock. This client sets none, so the listener returns the parameters as they are.
"""

from __future__ import annotations

import json
import threading
from contextlib import ExitStack, suppress

from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from hil.run.parts.links.foxglove.gate import Address
from signals.errors import LinkError

_PROTOCOL = Subprotocol("foxglove.sdk.v1")
_CLOSE_S = 1.0  # longest wait for the server's answer at the end


class OwnClient:
    """A connection to the SDK's server, past the gate."""

    def __init__(self, inner: Address) -> None:
        """Connect. Raises LinkError."""
        host, port = inner
        self._stack = ExitStack()
        try:
            self._connection = self._stack.enter_context(
                connect(
                    f"ws://{host}:{port}",
                    subprotocols=[_PROTOCOL],
                    compression=None,
                    proxy=None,
                    ping_interval=None,
                    close_timeout=_CLOSE_S,
                    max_size=None,
                )
            )
        except (OSError, WebSocketException) as error:
            raise LinkError("Foxglove's server", f"does not answer behind its gate: {error}") from error
        reader = threading.Thread(target=_read_all, args=(self._connection,), name="foxglove own client", daemon=True)
        reader.start()

    def ask(self) -> None:
        """Let the SDK ask the listener for the parameters and send them to all clients that subscribed to them."""
        with suppress(ConnectionClosed):  # the server has stopped
            self._connection.send(json.dumps({"op": "setParameters", "parameters": []}))

    def close(self) -> None:
        """Disconnect. Idempotent."""
        self._stack.close()


def _read_all(connection: ClientConnection) -> None:
    """Read until the end, as the server ends connections that do not."""
    with suppress(ConnectionClosed):
        for _ in connection:
            pass
