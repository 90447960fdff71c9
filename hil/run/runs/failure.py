"""The first error of a run, which run.json reports whatever fails after it."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from signals.errors import ConfigError
from signals.shortage import named

_TRACEBACK_NAME = "traceback.txt"


class Failure:
    """Runs the steps of a run and keeps the first error. A defect of the bench writes its traceback to `out`."""

    def __init__(self, out: Path) -> None:
        self._traceback = out / _TRACEBACK_NAME
        self._error: dict[str, str] | None = None
        self.config_error: ConfigError | None = None  # the first error, if it is one of the user's files
        with suppress(OSError):
            self._traceback.unlink(missing_ok=True)  # of an earlier run in this folder

    @property
    def error(self) -> dict[str, str] | None:
        """The first error as in run.json: type, message, and cause if it has one. None: no error."""
        return self._error

    @property
    def text(self) -> str:
        """The first error in one line; empty without one."""
        return "" if self._error is None else f"{self._error['type']}: {self._error['message']}"

    def guard(self, step: Callable[[], object]) -> None:
        """Run one step, and keep its error if it is the run's first."""
        try:
            step()
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 (a defect of the bench must still leave run.json)
            self.note(error)

    def note(self, error: BaseException, where: str = "") -> None:
        """Keep this error if it is the run's first. `where` is put before its message, as in 'lead: '."""
        told = named(error)
        if self._error is None and isinstance(told, ConfigError):
            self.config_error = told
        if told is not None:
            cause = getattr(told, "cause", "")
            self._keep(type(told).__name__, f"{where}{told}", **({"cause": cause} if cause else {}))
        elif isinstance(error, KeyboardInterrupt):
            self._keep("Interrupted", str(error) or "stopped from the keyboard")
        else:
            with suppress(OSError):
                self._traceback.write_text("".join(traceback.format_exception(error)))
            text = f"{where}{type(error).__name__}: {error} (a defect of the bench; details in {_TRACEBACK_NAME})"
            self._keep("InternalError", text)

    def _keep(self, kind: str, message: str, **more: Any) -> None:
        self._error = self._error or {"type": kind, "message": message, **more}
