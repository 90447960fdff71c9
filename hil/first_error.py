"""What went wrong with the bench in a run: the first error counts, whatever fails after it."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hil.signals.errors import HilError

_TRACEBACK_NAME = "traceback.txt"


class FirstError:
    """`error` is (type, message) for run.json, None while all is well; `cause` one word, where the error has one."""

    def __init__(self, out: Path) -> None:
        self._traceback = out / _TRACEBACK_NAME
        self.error: tuple[str, str] | None = None
        self.cause = ""

    def forget_traceback(self) -> None:
        """Remove that of an earlier run."""
        with suppress(OSError):
            self._traceback.unlink(missing_ok=True)

    def guard(self, step: Callable[[], object]) -> None:
        """Run one step of the run; an error of it becomes the run's, if it is the first."""
        error: tuple[str, str] | None = None
        try:
            step()
        except HilError as problem:
            error = (type(problem).__name__, str(problem))
            self.cause = self.cause or getattr(problem, "cause", "")
        except KeyboardInterrupt as stop:
            error = ("Interrupted", str(stop) or "stopped from the keyboard")
        except Exception as problem:  # noqa: BLE001 (the one boundary: a defect of the bench must still leave run.json)
            with suppress(OSError):
                self._traceback.write_text(traceback.format_exc())
            text = f"{type(problem).__name__}: {problem} (a defect of the bench; details in {_TRACEBACK_NAME})"
            error = ("InternalError", text)
        self.error = self.error or error
