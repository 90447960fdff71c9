"""A program on the far side of a link that the bench starts, monitors and ends."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import firmware_bridge
from signals.errors import PortNotFound

_PR_SET_PDEATHSIG = 1
# Looked up before any fork: between fork and exec no library may be loaded.
_prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None

_TERMINATE_S = 2.0
_EXIT_S = 1.0
_STDERR_TAIL_BYTES = 8192


def _die_with_parent() -> None:
    """Make the kernel kill this process when the thread that started it ends, for any reason. Runs in the child."""
    if _prctl is not None:
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@dataclass(frozen=True)
class FirmwareBuild:
    """A user's build of a firmware and how to run it."""

    binary: Path
    folder: Path  # its working folder
    log: Path
    arguments: Sequence[str] = ()
    env: Mapping[str, str] = field(default_factory=dict)  # overrides the environment of the bench


class ChildProcess:
    """A process that runs `argv` without standard input. Standard error goes to `stderr_path` or a temporary file.

    Its working directory is `cwd` (made if it does not exist), or the bench's. It can import the bench's packages.
    With `log_output`, standard output joins standard error: firmware logs there. `env` overrides the environment.
    With `own_group`, programs that it starts are ended with it, and Ctrl-C at the terminal reaches the bench only.
    """

    def __init__(
        self,
        argv: Sequence[str],
        *,
        stderr_path: Path | None = None,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
        log_output: bool = False,
        own_group: bool = False,
    ) -> None:
        self.argv = list(argv)
        self._stderr_path = stderr_path
        self._cwd = cwd
        self._env = dict(env or {})
        self._log_output = log_output
        self._own_group = own_group
        self._stderr: IO[bytes] | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the program. PortNotFound if it does not exist."""
        if self._stderr_path is None:
            self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 (closed in close)
        else:
            self._stderr_path.parent.mkdir(parents=True, exist_ok=True)
            self._stderr = self._stderr_path.open("w+b")
        package_root = str(Path(firmware_bridge.__file__).resolve().parents[1])
        path = os.pathsep.join(p for p in (package_root, os.environ.get("PYTHONPATH")) if p)
        try:
            if self._cwd is not None:
                self._cwd.mkdir(parents=True, exist_ok=True)
            self._process = subprocess.Popen(
                self.argv,
                stdin=subprocess.DEVNULL,
                stdout=self._stderr if self._log_output else subprocess.DEVNULL,
                stderr=self._stderr,
                cwd=self._cwd,
                env=os.environ | {"PYTHONPATH": path} | self._env,
                preexec_fn=_die_with_parent,
                start_new_session=self._own_group,
            )
        except OSError as error:
            self._stderr.close()
            raise PortNotFound(self.argv[0], f"cannot be started ({error.strerror}); is the path right?") from error

    @property
    def exit_status(self) -> int | None:
        """Exit status, negative for a signal; None while it runs or before it was started."""
        return None if self._process is None else self._process.poll()

    def running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def stderr_tail(self) -> str:
        """Return the last five lines that the program wrote to standard error, "" if none."""
        if self._stderr is None or self._stderr.closed:
            return ""
        fd = self._stderr.fileno()
        size = os.fstat(fd).st_size
        # pread: the child writes through the same file description, whose position must not be moved.
        text = os.pread(fd, _STDERR_TAIL_BYTES, max(0, size - _STDERR_TAIL_BYTES)).decode(errors="replace")
        return "\n".join(text.rstrip().splitlines()[-5:])

    def describe_end(self) -> str:
        """Describe how the program ended and quote its last output, for an error message.

        Waits a moment for a program that is ending.
        """
        if self._process is None:
            return "its process was never started"
        try:
            code = self._process.wait(_EXIT_S)
        except subprocess.TimeoutExpired:
            how = f"its process (pid {self._process.pid}) still runs but has closed the link"
        else:
            how = (
                f"its process was ended by signal {signal.Signals(-code).name}"
                if code < 0
                else f"its process ended with exit status {code}"
            )
        tail = self.stderr_tail()
        return how + (f"; it last said:\n{tail}" if tail else "; it said nothing")

    def close(self) -> None:
        """End and reap the program: SIGTERM first, SIGKILL after two seconds."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.wait(_TERMINATE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if process is not None and self._own_group:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
        if self._stderr is not None:
            self._stderr.close()
