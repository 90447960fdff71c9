"""run.json from the begin of a run to its end: it always says how the run ended, also by a crash or on a full disk."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from hil.run.report.run_json import run_json_text, write_run_json
from hil.run_files import RUN_JSON_NAME
from signals._kernel import guard_file
from signals.errors import DiskFull, RecordingError
from signals.shortage import CRASHED, OUT_OF_MEMORY, shortage

_RESERVE_BYTES = 64 << 10  # several times a usual run.json
_KILLED = "the run is still going on, or it was killed before it could write its result, as when memory runs out"
# Of a run.json that does not fit on the disk, the keys that every run has.
_SHORT = frozenset(
    (
        *("schema", "status", "error", "digest", "deterministic", "seed", "rig", "scene", "sim_s", "wall_s"),
        *("realtime_factor", "mission", "autopilot", "sensors", "skipped"),
    )
)


class RunFile:
    """The run.json of a folder, and the space that it will take."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / RUN_JSON_NAME
        self._reserve: IO[bytes] | None = None

    def begin(self, run: Mapping[str, Any]) -> dict[str, Any]:
        """Write the state of a run that begins, so that an earlier result does not pass for this one's; return it.

        Where a native library ends the process, the file tells that instead. Raises RecordingError.
        """
        killed, crashed, no_memory = (
            {**run, "status": "ERROR", "error": {"type": kind, "message": text}}
            for kind, text in (("Killed", _KILLED), ("Crashed", CRASHED), ("OutOfMemory", OUT_OF_MEMORY))
        )
        write_run_json(self._path, killed)
        guard_file(str(self._path.absolute()), run_json_text(crashed), run_json_text(no_memory))
        return killed

    def reserve(self) -> None:
        """Take the space that the end of the run needs, or what is left, so that no recording can. Raises DiskFull."""
        if self._reserve is None:
            try:
                self._reserve = tempfile.TemporaryFile(dir=self._path.parent, buffering=0)  # noqa: SIM115
                self._reserve.write(bytes(_RESERVE_BYTES))
            except OSError as error:
                self._release()
                raise shortage(error) or RecordingError(f"{self._path}: cannot be written ({error})") from error

    def end(self, run: dict[str, Any]) -> dict[str, Any]:
        """Write the result, and return it. Without space for all of it, it is an ERROR, and a short one is written.

        Raises RecordingError if nothing can be written.
        """
        self._release()
        try:
            write_run_json(self._path, run)
        except RecordingError as error:
            told = run["error"] or {"type": DiskFull.__name__, "message": str(error)}
            run = {**run, "status": "ERROR", "error": told}
            short = {key: value for key, value in run.items() if key in _SHORT}
            try:
                write_run_json(self._path, short)
            except RecordingError:
                self._overwrite(run_json_text(short), error)
        guard_file(str(self._path.absolute()), "", "")
        return run

    def _overwrite(self, text: str, earlier: RecordingError) -> None:
        """Write into the space of the present file. Raises `earlier` if that fails."""
        try:
            with self._path.open("r+", encoding="utf-8") as file:
                file.write(text)
                file.truncate()
        except OSError:
            raise earlier from None

    def _release(self) -> None:
        if self._reserve is not None:
            self._reserve.close()
            self._reserve = None
