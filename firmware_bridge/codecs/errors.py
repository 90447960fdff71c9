"""Errors in the contents of a message, as opposed to those of its transport."""

from __future__ import annotations

from signals.errors import HilError


class CodecError(HilError, ValueError):
    """A value does not fit its field, a payload does not fit its message, or the message is unknown."""
