"""Long work on the world in a thread, while the event loop goes on answering calls that need no world.

The thread has the world alone: time stands still, and a client whose next call needs the world is read on after the
work, in the order of the calls. So the work changes nothing but the time that its call takes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from hil.apps.airsim.rpc.methods import Pending, RpcError


class WorldLock:
    """Lock of one server's world. Its methods are called in the event loop."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """`wake` is called after each work: time may go on."""
        self.held = False
        self._wake = wake
        self._waiting: list[Callable[[], None]] = []

    def then(self, listener: Callable[[], None]) -> None:
        """Call `listener` once, after the present work."""
        self._waiting.append(listener)

    def run(self, work: Callable[[], Any]) -> Pending:
        """Start work and return its result to come, an RpcError if it raises one. Without a loop it is done at once."""
        assert not self.held
        pending = Pending()
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            pending.resolve(work())
            return pending
        self.held = True
        loop.run_in_executor(None, work).add_done_callback(lambda future: self._end(future, pending))
        return pending

    def _end(self, future: asyncio.Future[Any], pending: Pending) -> None:
        self.held = False
        if not future.cancelled():
            error = future.exception()
            if error is not None and not isinstance(error, RpcError):
                error = RpcError(f"{type(error).__name__}: {error} (a defect of the server)")
            pending.resolve(future.result() if error is None else error)
        self._wake()
        waiting, self._waiting = self._waiting, []
        for listener in waiting:
            listener()
