"""Errors of the companion client. Each message says on one line what was wrong, where, and what to do."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator


class CompanionError(Exception):
    """Base of all errors of the companion client."""


class OptionError(CompanionError):
    """An option, a file or a setting of this program is wrong."""


class NoBench(CompanionError):
    """No bench answered before the timeout."""


class WrongKeys(CompanionError):
    """The encrypted handshake failed: keys missing, wrong, or not allowed."""


class Refused(CompanionError):
    """The bench refused this client. `code` is one of protocol.REFUSALS, `text` the bench's explanation."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"refused by the bench ({code}): {text}")
        self.code = code
        self.text = text


class SchemaChanged(Refused):
    """After a reconnection the bench sends other data than before."""

    def __init__(self, text: str) -> None:
        super().__init__("schema", text)


class ConnectionLost(CompanionError):
    """An open connection was lost."""


class BadMessage(CompanionError):
    """A message that does not follow the protocol."""


class CutError(CompanionError):
    """The client under test failed, or returned a value that cannot be sent."""


@contextmanager
def file_errors(what: str) -> Iterator[None]:
    """Raise CutError for an OSError in the block: `what`, such as "FILE cannot be written", with the reason."""
    try:
        yield
    except OSError as error:
        raise CutError(f"{what} ({error.strerror or error})") from error
