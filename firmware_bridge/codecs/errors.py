"""What can be wrong with a message itself, as opposed to the wire it travels on."""

from __future__ import annotations

from hil.signals.errors import HilError


class CodecError(HilError, ValueError):
    """A value does not fit its field, a payload is not what its message says, or nobody knows the message."""
