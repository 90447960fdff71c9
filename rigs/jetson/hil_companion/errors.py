"""What can go wrong on the way to a bench. Each message says what, where and what to do, on one line."""

from __future__ import annotations


class CompanionError(Exception):
    """Base of all errors of the companion client."""


class OptionError(CompanionError):
    """An option, a file or a setting of this program is wrong."""


class NoBench(CompanionError):
    """Nobody answered as a bench in time."""


class WrongKeys(CompanionError):
    """The encrypted handshake failed: keys missing, wrong, or not allowed."""


class Refused(CompanionError):
    """The bench said no. `code` is one of protocol.REFUSALS, `text` the bench's own words."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"refused by the bench ({code}): {text}")
        self.code = code
        self.text = text


class SchemaChanged(Refused):
    """The bench that came back sends other data than the one before."""

    def __init__(self, text: str) -> None:
        super().__init__("schema", text)


class ConnectionLost(CompanionError):
    """The connection was there and is gone."""


class BadMessage(CompanionError):
    """A message that does not follow the protocol."""


class CutError(CompanionError):
    """The algorithm under test itself failed, or returned what nobody can send."""
