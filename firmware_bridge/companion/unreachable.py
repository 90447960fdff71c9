"""The far side of a connection has gone."""

from __future__ import annotations


class Unreachable(Exception):  # never leaves the companion package
    """The peer has gone, or, where there is a text, must."""
