"""Process entry of the `hil` command: signals, and the last handler of errors.

It has few imports, so that an error in any other import ends in one message and a status, not in a traceback.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from hil.cli.status import ERROR_STATUS
from hil.cli.streams import keep_streams
from signals.shortage import CRASHED, OUT_OF_MEMORY, has_memory, named
from signals.stop_signals import stop_signals


class Stopped(KeyboardInterrupt):
    """Request of a signal to end the command. It is handled like Ctrl-C, so that a run closes its recordings."""

    newest: Stopped | None = None


def _stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    if number == signal.SIGINT and not has_memory():
        raise MemoryError("a library stopped the program, as OpenBLAS does when it gets no thread")
    Stopped.newest = Stopped(f"stopped by {signal.Signals(number).name}")
    raise Stopped.newest


def _raise_again(ignored: sys.UnraisableHookArgs) -> None:
    """Raise a lost Stopped again 50 ms later.

    The interpreter drops exceptions of some callbacks, for example after a fork. A signal during such a callback would
    be lost, and the run would continue.
    """
    stop = ignored.exc_value
    if not isinstance(stop, Stopped) or not hasattr(signal, "setitimer"):
        sys.__unraisablehook__(ignored)
        return

    def raise_stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise stop

    signal.signal(signal.SIGALRM, raise_stop)
    signal.setitimer(signal.ITIMER_REAL, 0.05)


def main() -> NoReturn:
    """Run the command line and exit with its status: 0 PASS, 1 FAIL, 2 wrong files or options, 3 ERROR."""
    # Loading the bench's modules makes some hundred thousand objects that stay, and the collector would search them
    # again and again: an eighth of a short command's time.
    gc.set_threshold(20_000)
    _handle_signals(_stop)
    keep_streams()
    sys.unraisablehook = _raise_again
    # The bench does not render with MuJoCo. A MUJOCO_GL set for other programs could make the import of MuJoCo fail.
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        _guard_crashes()
        from hil.cli.app import run_command_line

        status = run_command_line(sys.argv[1:])
        _end_at_signals(status)
    except KeyboardInterrupt as stop:
        _end_at_signals(ERROR_STATUS)
        status = _print_error(str(stop) or "stopped from the keyboard", ERROR_STATUS)
    except Exception as defect:
        if os.environ.get("HIL_TRACEBACK"):
            raise
        # A signal within the import of an extension module becomes an ImportError.
        told = Stopped.newest if isinstance(defect, ImportError) and Stopped.newest is not None else named(defect)
        defect_text = f"{type(defect).__name__}: {defect} (a defect of the bench; HIL_TRACEBACK=1 shows where)"
        status = _print_error(defect_text if told is None else str(told), ERROR_STATUS)
    _end_crashes(status)
    _leave(status)


def _guard_crashes() -> None:
    """Let a crash of a native library end with a message, run.json and the status of an ERROR."""
    if not os.environ.get("HIL_TRACEBACK") and not faulthandler.is_enabled():
        from signals._kernel import guard_crashes

        guard_crashes(ERROR_STATUS, f"error: {CRASHED}\n", f"error: {OUT_OF_MEMORY}\n")


def _end_crashes(status: int) -> None:
    """Let nothing that a native library does at exit change the status."""
    kernel = sys.modules.get("signals._kernel")
    if kernel is not None:
        kernel.guard_end(status)


def _handle_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    for number in stop_signals():
        signal.signal(number, handler)


def _end_at_signals(status: int) -> None:
    """Let a signal end the process at once with this status: the command is over, only the interpreter still exits."""

    _handle_signals(lambda number, frame: _exit_at_once(status))  # noqa: ARG005


def _exit_at_once(status: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(RuntimeError, ValueError):  # a signal came within a write to it, or it is closed
            stream.flush()
    os._exit(status)


def _leave(status: int) -> NoReturn:
    """Exit after the threads and the exit handlers, but free no objects.

    That would take a seventh of a short run's processor time. Python has given up its signal handlers by then, so that
    a signal would replace the status of a command that is over.
    """
    _end_at_signals(status)
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    _exit_at_once(status)


def _print_error(text: str, status: int) -> int:
    sys.stderr.write(f"error: {text}\n")
    return status


if __name__ == "__main__":
    main()
