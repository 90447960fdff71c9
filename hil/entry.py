"""Where the `hil` command starts. Light on purpose: whatever happens from the first import on, and whatever stops the
command, it ends in one message and a status, never in a traceback.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from types import FrameType

CONFIG_STATUS, ERROR_STATUS = 2, 3


class Stopped(KeyboardInterrupt):
    """A signal asked the command to end; handled like Ctrl-C, so that a run closes its recordings."""


def _stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    raise Stopped(f"stopped by {signal.Signals(number).name}")


def _raise_again(ignored: sys.UnraisableHookArgs) -> None:
    """Raise a lost Stopped once more, 50 ms later.

    A signal may come while the interpreter runs a callback whose exceptions it drops (those after a fork): without
    this the request to stop would be lost, and the run would fly on.
    """
    stop = ignored.exc_value
    if not isinstance(stop, Stopped) or not hasattr(signal, "setitimer"):
        sys.__unraisablehook__(ignored)
        return

    def raise_stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise stop

    signal.signal(signal.SIGALRM, raise_stop)
    signal.setitimer(signal.ITIMER_REAL, 0.05)


def main() -> None:
    """Run the command line and exit with its status: 0 PASS, 1 FAIL, 2 wrong files or options, 3 ERROR."""
    # SIGINT too: a shell script that starts us in the background would have it ignored.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _stop)
    sys.unraisablehook = _raise_again
    # The bench never draws with MuJoCo; a MUJOCO_GL meant for other programs must not keep it from being imported.
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        from hil.cli import run_command_line

        status = run_command_line(sys.argv[1:])
    except KeyboardInterrupt as stop:
        status = _complain(str(stop) or "stopped from the keyboard", ERROR_STATUS)
    except BrokenPipeError:
        status = ERROR_STATUS  # whoever read our output is gone; there is nobody to tell
    except Exception as defect:
        if os.environ.get("HIL_TRACEBACK"):
            raise
        text = f"{type(defect).__name__}: {defect} (a defect of the bench; HIL_TRACEBACK=1 shows where)"
        status = _complain(text, ERROR_STATUS)
    _leave_quietly()
    sys.exit(status)


def _leave_quietly() -> None:
    """A pipe that is closed would make the interpreter complain, and change the status, when it flushes at exit."""
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except (OSError, ValueError, AttributeError):
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 (lives until the process ends)


def _complain(text: str, status: int) -> int:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"error: {text}\n")
    return status


if __name__ == "__main__":
    main()
