"""Client of the path tracer's process: starts it with an LLVM that works, sends the scene once and then poses.

The process is a child started with `WORKER`. If it ends (an abort of LLVM, no memory, a signal), or reports an error,
the client raises PathTracerError; the bench goes on.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import weakref
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from signals.processors import usable_processors
from sim.frame.path_traced import llvm
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.protocol import LensData, RenderRequest, StartRequest
from sim.frame.path_traced.sky_request import SkyRequest

WORKER = (sys.executable, "-P", "-m", "sim.frame.path_traced.worker")
INSTALL = "pip install 'hil-bench[photo]'"
_START_S, _ANSWER_S = 120.0, 1800.0
_CLOSE_S = 2.0
_LOG_BYTES = 4000

threads_per_process = 0  # of tracers started from now on; 0: one per core


class TracerProcess:
    """Running process of the path tracer. Raises PathTracerError if none can be started."""

    def __init__(self, sky: SkyRequest, scene: dict[str, Any]) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._log: IO[bytes] | None = None
        self._start(StartRequest(sky, threads_per_process or usable_processors()))
        self._ask("load", scene)
        self._owner = os.getpid()

    @property
    def usable(self) -> bool:
        """True if this process started the tracer (a fork of it did not) and has not closed it."""
        return self._connection is not None and self._owner == os.getpid()

    def add_lens(self, number: int, lens: LensData) -> None:
        """Store a camera under a number."""
        self._ask("lens", number, lens)

    def render(self, request: RenderRequest) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3) in sRGB codes. Raises PathTracerError."""
        picture: NDArray[np.uint8] = self._ask("render", request)
        return picture

    def surfaces(self, request: RenderRequest) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the geom at each pixel's centre (-1: none), and its distance along the ray [m]."""
        geom, range_m = self._ask("surfaces", request)
        return geom, range_m

    def cpu_s(self) -> float:
        """Return the processor time of the process so far, in seconds."""
        return float(self._ask("cpu_s"))

    def close(self) -> None:
        """End the process. Idempotent."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            _end(self._process)
            self._process = None
        if self._log is not None:
            self._log.close()
            self._log = None

    def _start(self, request: StartRequest) -> None:
        libraries = llvm.find_libraries()
        failures = list(libraries.refused)
        for library in libraries.usable:
            self._spawn(library)
            try:
                self._ask("start", request, limit_s=_START_S)
            except _EndedError as error:
                failures.append(f"{library} {error}")
                continue
            return
        found = "; ".join(failures) if failures else "there is none"
        raise PathTracerError(f"the path tracer finds no LLVM that works: {found}: {llvm.INSTALL}")

    def _spawn(self, library: Path) -> None:
        self.close()
        ours, theirs = socket.socketpair()
        log = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        environment = {**os.environ, llvm.VARIABLE: str(library)}
        try:
            with theirs:
                self._process = subprocess.Popen(
                    [*WORKER, str(theirs.fileno())],
                    pass_fds=(theirs.fileno(),),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    env=environment,
                    start_new_session=True,  # Ctrl-C ends the bench, which ends the tracer
                )
        except OSError as error:
            ours.close()
            log.close()
            raise PathTracerError(f"the path tracer's process cannot be started: {error}") from error
        self._connection, self._log = Connection(ours.detach()), log
        weakref.finalize(self, _end, self._process)

    def _ask(self, name: str, *arguments: Any, limit_s: float = _ANSWER_S) -> Any:
        connection = self._connection
        if connection is None:
            raise PathTracerError("the path tracer's process has ended; start the command again")
        try:
            connection.send((name, *arguments))
            if not connection.poll(limit_s):
                self.close()
                raise PathTracerError(f"the path tracer has not answered for {limit_s:.0f} s, so its process was ended")
            status, result = connection.recv()
        except (EOFError, OSError) as error:
            how = self._how_it_ended()
            self.close()
            if name == "start":
                raise _EndedError(how) from error
            raise PathTracerError(
                f"the path tracer's process {how} during '{name}': try fewer pixels, or fewer processes at once"
            ) from error
        if status == "ok":
            return result
        self.close()
        if status == "missing":
            raise PathTracerError(f"the path tracer needs the packages mitsuba and mitsuba-oidn ({result}): {INSTALL}")
        raise PathTracerError(f"the path tracer cannot do '{name}': {result}")

    def _how_it_ended(self) -> str:
        assert self._process is not None
        assert self._log is not None
        try:
            code = self._process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            return "closed its connection"
        if code >= 0:
            how = f"ended with status {code}"
        else:
            try:
                how = f"was ended by {signal.Signals(-code).name}"
            except ValueError:
                how = f"was ended by signal {-code}"
        if code == -signal.SIGKILL:
            how += ", as the system does when memory runs out"
        self._log.seek(0)
        lines = [line.strip() for line in self._log.read(_LOG_BYTES).decode("utf-8", "replace").splitlines()]
        lines = [line for line in lines if line]
        return f"{how} ({lines[0] if 'LLVM' in lines[0] else lines[-1]})" if lines else how


class _EndedError(Exception):
    """The process ended before it was ready."""


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process that has no connection any more."""
    with contextlib.suppress(ProcessLookupError):
        if process.poll() is None:
            process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_CLOSE_S)
