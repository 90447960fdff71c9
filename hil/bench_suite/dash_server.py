"""The dashboard's server and pages round it, in processes of their own, for measurements."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from hil.child_environment import child_environment
from hil.dash_command import server_process
from hil.dashboard.serve import open_port
from hil.signals.errors import HilError

_WAIT_S = 60.0  # a server beside other work takes its time to load
_PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")


class ServedPages:
    """`wire` is the run's end. Pages connect at once and follow until `end`."""

    def __init__(self, folder: Path, pages: Sequence[Sequence[str]]) -> None:
        """`pages`: of each its open panes."""
        self.wire, theirs = socket.socketpair()
        with theirs, open_port("127.0.0.1", 0) as listening:
            self.host = f"127.0.0.1:{listening.getsockname()[1]}"
            self._server = server_process(listening, theirs, config=None, runs=folder, token=None)
        self._pages = [
            subprocess.Popen(
                [sys.executable, "-m", "hil.bench_suite.dash_page", self.host, *streams],
                env=child_environment(),
                stdout=subprocess.PIPE,
            )
            for streams in pages
        ]

    def wait_for_page(self) -> None:
        """Until one asks for its first update. HilError where none does."""
        ready, _, _ = select.select([self.wire], [], [], _WAIT_S)
        if not ready:
            raise HilError(f"no page has come to the dashboard's server within {_WAIT_S:g} s")

    @property
    def memory_bytes(self) -> int:
        """Of the server, resident. 0 where the system does not tell."""
        try:
            return int(Path(f"/proc/{self._server.pid}/statm").read_text().split()[1]) * _PAGE_SIZE
        except (OSError, IndexError, ValueError):
            return 0

    @property
    def processor_s(self) -> tuple[float, float]:
        """Used so far by the server, and by the pages together. Zeros where the system does not tell."""
        return _processor_s(self._server.pid), sum(_processor_s(page.pid) for page in self._pages)

    def hold(self, still: bool) -> None:
        """Server and pages stand still, or go on."""
        for process in (self._server, *self._pages):
            process.send_signal(signal.SIGSTOP if still else signal.SIGCONT)

    def end(self) -> list[dict[str, Any]]:
        """What each page had."""
        self.wire.close()
        self._server.terminate()
        self._server.wait(_WAIT_S)
        told = []
        for page in self._pages:
            out, _ = page.communicate(timeout=_WAIT_S)
            told.append(json.loads(out or b"{}"))
        return told

    def __enter__(self) -> ServedPages:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.wire.close()
        for process in (self._server, *self._pages):
            if process.poll() is None:
                process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()


def _processor_s(pid: int) -> float:
    """To the nanosecond, of all threads that are there."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        return 1e-9 * sum(int((task / "schedstat").read_text().split()[0]) for task in tasks)
    except (OSError, IndexError, ValueError):
        return 0.0
