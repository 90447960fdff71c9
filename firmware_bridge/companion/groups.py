"""Groups of topics: those of one sensor, which have a port of their own where sensors have."""

from __future__ import annotations

CONTROL = ""  # the group of the first socket, at which clients knock


def group_of(topic: str) -> str:
    """The sensor that a topic belongs to: what is before the first slash."""
    return topic.partition("/")[0]
