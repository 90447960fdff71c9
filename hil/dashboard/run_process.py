"""A run started from the page: `hil run` in a process of its own, exactly as from the command line."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
from collections.abc import Sequence

from hil.dashboard.hub import Hub

_LAST_BYTES = 4000  # of what the run printed as errors
_STOP_S = 10.0


class RunProcess:
    """At most one at a time; the hub follows it."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def going(self) -> bool:
        return self._hub.going or (self._task is not None and not self._task.done())

    def start(self, arguments: Sequence[str]) -> None:
        """`hil run` with these arguments. Nothing happens while another run goes."""
        if not self.going:
            self._task = asyncio.get_running_loop().create_task(self._run(list(arguments)))

    async def stop(self) -> None:
        """End the run as Ctrl-C does, and wait for it."""
        process, task = self._process, self._task
        if process is not None and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        if task is not None:
            done, _ = await asyncio.wait([task], timeout=_STOP_S)
            if not done and process is not None and process.returncode is None:
                process.kill()

    async def _run(self, arguments: list[str]) -> None:
        ours, theirs = socket.socketpair()
        hub = self._hub
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "hil.entry",
                "run",
                "--quiet",
                f"--dash-fd={theirs.fileno()}",
                *arguments,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                pass_fds=(theirs.fileno(),),
            )
        except OSError as error:
            ours.close()
            hub.message = f"the run cannot be started ({error.strerror or error})"
            return
        finally:
            theirs.close()
        following = asyncio.get_running_loop().create_task(hub.follow(ours))
        assert self._process.stderr is not None
        said = b""
        while piece := await self._process.stderr.read(4096):
            said = (said + piece)[-_LAST_BYTES:]
        status = await self._process.wait()
        await following
        if hub.result is None:  # it never got so far as to say itself how it went
            hub.message = said.decode(errors="replace").strip() or f"the run ended with status {status}"
        await hub.changed()
