"""A log's format, and the reader of a log of any format: every module of `formats/` with a `FORMAT`.

A new format is one file: `recognises` looks at the first bytes and the name, `read` returns the whole log as a
`FlightLog` in the conventions of `flight_log.py`. Shortcomings that a fit can live with go to `LogFile.notes`; others
raise ConfigError.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from hil.run.flight_logs import formats as modules
from hil.run.flight_logs.flight_log import FlightLog
from hil.run_files import MCAP_NAME
from signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle

HEAD_BYTES = 64


@dataclass(frozen=True)
class LogFile:
    """A log to read. `columns` is the map of a table's columns, `of` the vehicle of a recording that has several."""

    path: Path
    vehicle: Vehicle
    columns: Path | None = None
    of: str = ""
    notes: list[Problem] = field(default_factory=list)
    topics: dict[str, str] = field(default_factory=dict)  # name in the log of each series of FlightLog that it has

    def topic(self, series: str) -> str:
        """Return the log's own name of a series, such as `rate`."""
        return self.topics.get(series, series)

    def refuse(self, message: str, hint: str = "", *, topic: str = "") -> ConfigError:
        """Return the error for a log that cannot be used; `message` begins with the verb."""
        return ConfigError([self._problem(message, hint, topic)])

    def note(self, message: str, hint: str = "", *, topic: str = "") -> None:
        """Say what is wrong with a log that is used all the same."""
        self.notes.append(self._problem(message, hint, topic))

    def _problem(self, message: str, hint: str, topic: str) -> Problem:
        return Problem(f"{self.path}: {topic}" if topic else str(self.path), message, hint)


@dataclass(frozen=True)
class Format:
    """A format of logs. `recognises` gets the first bytes of a file, at most `HEAD_BYTES`, and its path."""

    name: str
    recognises: Callable[[bytes, Path], bool]
    read: Callable[[LogFile], FlightLog]


@cache
def formats() -> tuple[Format, ...]:
    """Return the formats in the order of their modules' names."""
    names = sorted(module.name for module in iter_modules(modules.__path__))
    found = [getattr(import_module(f"{modules.__name__}.{name}"), "FORMAT", None) for name in names]
    return tuple(item for item in found if isinstance(item, Format))


def read_log(file: LogFile) -> FlightLog:
    """Return the whole log. Raises ConfigError for a file that is no log, or one without what every fit needs."""
    path = file.path
    if path.is_dir() and (path / MCAP_NAME).is_file():
        return read_log(replace(file, path=path / MCAP_NAME))
    try:
        with open(path, "rb") as opened:
            head = opened.read(HEAD_BYTES)
    except OSError as error:
        raise file.refuse(f"cannot be read ({error.strerror or error})") from error
    if not head:
        raise file.refuse("is empty", "copy it from the vehicle again")
    for item in formats():
        if item.recognises(head, path):
            return item.read(file)
    known = ", ".join(item.name for item in formats())
    raise file.refuse("is no log of a known format", f"known: {known}; {_remedy(head, path)}")


def _remedy(head: bytes, path: Path) -> str:
    if path.suffix == ".tlog":
        return "a telemetry log has no motor outputs at a useful rate: take the log from the vehicle's own card"
    if path.suffix == ".log" and head[:3] in (b"FMT", b"PAR"):
        return "this is DataFlash as text: take the .bin from which it was made"
    return "a table of other software can be exported as CSV and read with --columns"
