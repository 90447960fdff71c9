"""Named errors of the bench. A message says what was wrong, where, and what to do about it.

Exit status of the command line: 2 for `ConfigError`, 3 for every other `HilError` (the bench broke: ERROR).
A vehicle that misses its limits is not an error but a FAIL, exit status 1.

A new sensor, link or part raises one of these: `ConfigError` for mistakes in a user's file, with a `Problem` for each
(for a sensor's parameters the pydantic model makes them); a `LinkError` for a connection; `RecordingError` for files of
a run. ValueError and TypeError are for mistakes of a caller in the program.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


class HilError(Exception):
    """Base of every error that the bench raises on purpose. `str(error)` is the message for the user."""


@dataclass(frozen=True)
class Problem:
    """One mistake in a user's file.

    `where` is 'file:line' or 'file'; `message` starts with the name of the value, or with the verb; `hint` says what to
    do.
    """

    where: str
    message: str
    hint: str = ""

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" + (f" ({self.hint})" if self.hint else "")


class ConfigError(HilError):
    """All mistakes found in the user's files."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("\n".join(str(p) for p in problems))

    @classmethod
    def at(cls, where: str, message: str, hint: str = "") -> ConfigError:
        """Return the error of one `Problem`."""
        return cls([Problem(where, message, hint)])


class WiringError(HilError):
    """Stages that do not fit together: an input without a producer, two producers of one port, or an algebraic loop."""


class ModelRangeError(HilError):
    """Departure of a simulated vehicle from the range in which its model holds; `cause` if it is known.

    `vehicle`: its name in a group of several; the message names it before the variable.
    """

    def __init__(
        self, tick: int, variable: str, value: float, limit: str, *, cause: str = "", vehicle: str = ""
    ) -> None:
        self.tick, self.variable, self.value, self.limit, self.cause = tick, variable, value, limit, cause
        self.vehicle = vehicle
        more = f": {cause}" if cause else ""
        owner = f"{vehicle}/" if vehicle else ""
        super().__init__(f"tick {tick}: {owner}{variable} = {value!r} is outside the model's range ({limit}){more}")


class LinkError(HilError):
    """Base of the errors of a connection.

    `port` names the connection; `cause` is one word for programs to branch on ("" if there is only one), such as those
    of `firmware_bridge.links.silence`.
    """

    def __init__(self, port: str, message: str, *, cause: str = "") -> None:
        self.port = port
        self.cause = cause
        super().__init__(f"{port}: {message}")


class PortNotFound(LinkError):
    """Serial port, socket or program of the rig that does not exist."""


class PortBusy(LinkError):
    """Port that another program holds open."""


class LinkClosed(LinkError):
    """Link that the peer closed, or whose process ended."""


class LockstepLost(LinkError):
    """Missing reply to a tick within the wall-clock limit, or a reply to another tick."""


class HandshakeError(LinkError):
    """Reply that breaks the protocol: no heartbeat, mission refused, command denied."""


class RecordingError(HilError):
    """Recording that cannot be written or read."""


@contextmanager
def file_errors(path: Path, what: str = "cannot be written", *, hint: str = "") -> Iterator[None]:
    """Raise RecordingError for an OSError in the block: that `path` `what`, with the system's reason and `hint`."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path}: {what} ({error.strerror or error}){hint}") from error


class Shortage(HilError):
    """Resource of the system that ran out. `signals.shortage` recognises it in the errors of libraries."""


class OutOfMemory(Shortage):
    """No memory, or no thread, is left for this process."""


class OutOfFiles(Shortage):
    """No file descriptor is left."""


class DiskFull(Shortage):
    """No space is left in a file system, a quota or a limit on the size of files."""
