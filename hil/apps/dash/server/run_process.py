"""The `hil run` process that the page's Start button starts."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
from collections.abc import Sequence

from hil.apps.dash.server.hub import Hub

_ERROR_BYTES = 4000  # kept of the run's standard error
_STOP_S = 10.0


class RunProcess:
    """A `hil run` process that the hub follows; at most one at a time."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._following: asyncio.Task[None] | None = None  # of the hub's `follow`

    @property
    def running(self) -> bool:
        return self._hub.running or (self._task is not None and not self._task.done())

    def start(self, arguments: Sequence[str]) -> None:
        """Start `hil run` with these arguments, unless another run is under way."""
        if not self.running:
            self._following = None
            self._task = asyncio.get_running_loop().create_task(self._run(list(arguments)))

    async def exited(self) -> bool:
        """Wait for the process of a finished run to exit. Return True, or False at once if the run is not over."""
        if self._task is None or self._following is None or not self._following.done():
            return False
        await asyncio.wait([self._task])
        return True

    def interrupt(self) -> None:
        """Interrupt the run as Ctrl-C does."""
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGINT)

    async def stop(self) -> None:
        """Interrupt the run, and wait for its end."""
        process, task = self._process, self._task
        self.interrupt()
        if task is not None:
            done, _ = await asyncio.wait([task], timeout=_STOP_S)
            if not done and process is not None and process.returncode is None:
                process.kill()
                await asyncio.wait([task], timeout=_STOP_S)  # until then no other run can start

    async def _run(self, arguments: list[str]) -> None:
        server_end, run_end = socket.socketpair()
        hub = self._hub
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-P",
                "-m",
                "hil.cli.entry",
                "run",
                "--quiet",
                f"--dash-fd={run_end.fileno()}",
                *arguments,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                pass_fds=(run_end.fileno(),),
            )
        except OSError as error:
            server_end.close()
            hub.message = f"the run cannot be started ({error.strerror or error})"
            return
        finally:
            run_end.close()
        self._following = asyncio.get_running_loop().create_task(hub.follow(server_end))
        assert self._process.stderr is not None
        error_text = b""
        while piece := await self._process.stderr.read(4096):
            error_text = (error_text + piece)[-_ERROR_BYTES:]
        status = await self._process.wait()
        await self._following
        if hub.result is None:  # the run failed before it could report a result
            hub.message = error_text.decode(errors="replace").strip() or f"the run ended with status {status}"
        hub.publish()
