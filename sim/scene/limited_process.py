"""Runs a function on a user's file in a process of its own, with limits of memory and processor time.

Readers of pictures, GEOS and MuJoCo's compiler cannot be interrupted, and what they allocate cannot be counted before.
The process can be ended: by its limits, and at once by a signal to the bench.

A first process (the host) imports the modules once and waits; it forks one process for each call. It ends after some
seconds without a call, and with the bench.

    bench -> host    a line of JSON: folder, function, working directory, limits
    host -> bench    a line of JSON: status of the process as of os.waitpid, processor time [s]
    folder           arguments.pickle, result.pickle, progress.txt: written and read by this program alone

While a call takes longer than about a second, the bench's display of progress is open, if it has one.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import json
import os
import pickle
import resource
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from signals.errors import ConfigError
from sim.scene.budget import Budget
from sim.scene.work_progress import progress, read_state

_ARGUMENTS, _RESULT = "arguments.pickle", "result.pickle"
_IDLE_S = 20.0
_LEAST_S = 1.0  # of processor time for a call, however little is left
_PATIENCE_S, _LOOK_S = 1.0, 0.1  # before progress is shown; between two looks at it


def limited(function: str, *arguments: Any, budget: Budget, what: str) -> Any:
    """Return what a function, "module:name", returns in a process with the limits of `budget`.

    Arguments and result are pickled. ConfigError of the function is raised here as well. So is one for a limit, with
    `what` as the part of the work that exceeds it, for any other error of the function, and for a crash.
    """
    with tempfile.TemporaryDirectory(prefix="hil-map-") as name:
        folder = Path(name)
        try:
            with (folder / _ARGUMENTS).open("wb") as file:
                pickle.dump(arguments, file, protocol=5)
        except OSError as error:
            raise _no_space(folder, error) from None
        status, cpu_s = _host.call(
            {
                "folder": name,
                "function": function,
                "tells": progress.display is not None,
                "cwd": _working_directory(),
                "memory_bytes": int(budget.limits.memory_bytes),
                "cpu_s": max(budget.left_s, _LEAST_S),
            },
            lambda reply: _wait(reply, folder, budget.source, what),
        )
        if status != 0 or not (folder / _RESULT).exists():
            raise _ended(status, budget, what)
        budget.seconds(cpu_s, what)
        with (folder / _RESULT).open("rb") as file:
            kind, value = pickle.load(file)  # noqa: S301 (written by `_work`)
    if kind == "result":
        return value
    if kind == "problems":
        raise ConfigError(value)
    if kind == "memory":
        raise budget.exceeded("memory_bytes", what)
    if kind == "space":
        raise _no_space(folder, value)
    hint = "the file may be damaged; if not, this is a defect of the bench"
    raise ConfigError.at(budget.source, f"cannot be made into a map: {value}", hint)


def _wait(reply: Any, folder: Path, source: str, what: str) -> None:
    """Wait for an answer, and show what the process does if that takes long."""
    if progress.display is None:
        return
    end_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end_s:
        if select.select([reply], [], [], _LOOK_S)[0]:
            return
    with progress.display(source) as show:
        while not select.select([reply], [], [], _LOOK_S)[0]:
            show(read_state(folder, what))


def _working_directory() -> str:
    try:
        return str(Path.cwd())
    except OSError:
        return "/"


def _no_space(folder: Path, error: OSError) -> ConfigError:
    hint = "make space, or name another folder by the environment variable TMPDIR"
    return ConfigError.at(str(folder.parent), f"a temporary file cannot be written: {error.strerror}", hint)


def _ended(status: int, budget: Budget, what: str) -> ConfigError:
    """Return the error for a process that a signal ended."""
    number = os.waitstatus_to_exitcode(status)
    if number == -signal.SIGXCPU:
        return budget.exceeded("cpu_s", what)
    cause = signal.Signals(-number).name if number < 0 else f"status {number}"
    message = f"{what} ended with {cause}"
    hint = "the system may have run out of memory" if number == -signal.SIGKILL else "the file may be damaged"
    return ConfigError.at(budget.source, message, hint)


class _Host:
    """The bench's end of the host; made again after it has ended, and in a process that was forked."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def call(self, request: dict[str, Any], wait: Callable[[Any], None]) -> tuple[int, float]:
        """Return status and processor time [s] of the process that worked on a request.

        `wait` is called with the pipe of the answer before that is read.
        """
        line = json.dumps(request).encode() + b"\n"
        with self._lock:
            try:
                reply = self._answer(line, wait) or self._answer(line, wait)  # the host may have ended meanwhile
            except BaseException:
                self.end()
                raise
        if not reply:
            return signal.SIGKILL, 0.0
        status, cpu_s = json.loads(reply)
        return int(status), float(cpu_s)

    def _answer(self, line: bytes, wait: Callable[[Any], None]) -> bytes:
        """Return the host's reply; b"" if it has ended."""
        process = self._process
        if process is None or self._owner != os.getpid() or process.poll() is not None:
            process = self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__],  # -P: nothing in the working directory is imported
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C reaches the bench only, which then ends this process
            )
            self._owner = os.getpid()
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(line)
            process.stdin.flush()
        wait(process.stdout)
        reply = process.stdout.readline()
        if not reply:
            self.end()
        return reply

    def end(self) -> None:
        """End the host and the process that it works with."""
        process, self._process = self._process, None
        if process is None or self._owner != os.getpid():
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        process.wait()


_host = _Host()
atexit.register(_host.end)


def main() -> int:
    """Serve requests on stdin until it is closed, or no request comes for a while."""
    while select.select([sys.stdin], [], [], _IDLE_S)[0]:
        line = sys.stdin.buffer.readline()
        if not line:
            break
        request = json.loads(line)
        importlib.import_module(request["function"].partition(":")[0])  # once, for the calls that follow
        done, writer = os.pipe()  # the process keeps `writer` until its end
        pid = os.fork()
        if pid == 0:
            os.close(done)
            _work(request)
        os.close(writer)
        if sys.stdin in select.select([sys.stdin, done], [], [])[0]:  # the bench has ended
            os.kill(pid, signal.SIGKILL)
        os.close(done)
        _, status, usage = os.wait4(pid, 0)
        sys.stdout.write(json.dumps((status, usage.ru_utime + usage.ru_stime)) + "\n")
        sys.stdout.flush()
    return 0


def _work(request: dict[str, Any]) -> None:
    """Answer one request, and end the process."""
    folder = Path(request["folder"])
    try:
        _limit(request["memory_bytes"], request["cpu_s"])
        if request["tells"]:
            progress.write_to(folder)
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):  # 1 is the host's answer
            os.dup2(nowhere, stream)
        with contextlib.suppress(OSError):
            os.chdir(request["cwd"])  # messages show files relative to it
        with (folder / _ARGUMENTS).open("rb") as file:
            arguments = pickle.load(file)  # noqa: S301 (written by `limited`)
        module, _, name = request["function"].partition(":")
        answer = _answer(getattr(sys.modules[module], name), arguments)
        with (folder / _RESULT).open("wb") as file:
            pickle.dump(answer, file, protocol=5)
    except MemoryError:
        gc.collect()
        (folder / _RESULT).write_bytes(pickle.dumps(("memory", "")))
    except OSError as error:
        (folder / _RESULT).write_bytes(pickle.dumps(("space", error)))
    except BaseException:  # noqa: BLE001 (the status tells it)
        os._exit(1)
    os._exit(0)


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[str, Any]:
    try:
        return "result", function(*arguments)
    except ConfigError as error:
        return "problems", error.problems
    except MemoryError:
        return "memory", ""
    except Exception as error:  # noqa: BLE001 (damaged files raise many types; none may show a traceback)
        text = " ".join(str(error).split())
        if "alloc" in text.lower():  # MuJoCo, OpenCV and GEOS say it in words
            return "memory", ""
        return "other", f"{type(error).__name__}: {text[:200]}"


def _limit(memory_bytes: int, cpu_s: float) -> None:
    """Limit this process to so much memory beyond what it has, and to so much processor time."""
    # The soft limit ends the process with SIGXCPU, which nothing else sends.
    _lower(resource.RLIMIT_CPU, int(cpu_s) + 1, spare=5)
    _lower(resource.RLIMIT_CORE, 0)
    held = 0
    with contextlib.suppress(OSError, ValueError, IndexError):
        held = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    _lower(resource.RLIMIT_DATA, held + memory_bytes)


def _lower(limit: int, value: int, *, spare: int = 0) -> None:
    """Set a limit of this process, unless a lower one is set already; `spare`: of the hard limit above the soft one."""
    hard = resource.getrlimit(limit)[1]
    most = value + spare if hard == resource.RLIM_INFINITY else min(value + spare, hard)
    if value <= most:
        with contextlib.suppress(ValueError, OSError):  # macOS does not have all of them
            resource.setrlimit(limit, (value, most))


if __name__ == "__main__":
    sys.exit(main())
