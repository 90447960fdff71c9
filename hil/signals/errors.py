"""Named errors of the bench. Each says what was wrong, where, and what to do about it.

Exit status of the command line: 2 for `ConfigError`, 3 for every other `HilError` (the bench broke: ERROR).
A vehicle that misses its limits is not an error but a FAIL, exit status 1.
"""

from __future__ import annotations

from dataclasses import dataclass


class HilError(Exception):
    """Base of every error the bench raises on purpose. `str(error)` is written for the person at the desk."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a user's file: `where` is 'file:line' or 'file', `hint` says what to do."""

    where: str
    message: str
    hint: str = ""

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" + (f" ({self.hint})" if self.hint else "")


class ConfigError(HilError):
    """The user's files are wrong. Carries every problem found, not only the first."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("\n".join(str(p) for p in problems))


class WiringError(HilError):
    """Stages do not fit together: an input nobody produces, two producers of one port, or an algebraic loop."""


class ModelRangeError(HilError):
    """The simulated vehicle left the range in which its model holds."""

    def __init__(self, tick: int, variable: str, value: float, limit: str) -> None:
        self.tick, self.variable, self.value, self.limit = tick, variable, value, limit
        super().__init__(f"tick {tick}: {variable} = {value!r} is outside the model's range ({limit})")


class LinkError(HilError):
    """Base of everything that can go wrong on a wire.

    `port` names the wire; `cause` is one word for a program to branch on where there are several ("" if not), such as
    those of `firmware_bridge.links.silence`.
    """

    def __init__(self, port: str, message: str, *, cause: str = "") -> None:
        self.port = port
        self.cause = cause
        super().__init__(f"{port}: {message}")


class PortNotFound(LinkError):
    """The serial port, socket or program named in the rig does not exist."""


class PortBusy(LinkError):
    """Somebody else holds the port."""


class LinkClosed(LinkError):
    """The far side closed the link or its process ended."""


class LockstepLost(LinkError):
    """No reply answering this tick came within the wall-clock limit, or the reply answered another tick."""


class HandshakeError(LinkError):
    """The far side answered, but not as the protocol demands (no heartbeat, mission refused, command denied)."""


class RecordingError(HilError):
    """A recording cannot be written or read."""
