"""Columns of one message of an autopilot's log, which tell what is missing.

A damaged log, or one of another firmware, has messages whose fields are not those that a reader knows. What a reader
can do without it asks for with `get` or `in`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from hil.run.flight_logs.log_format import LogFile


class MessageColumns(dict[str, NDArray[Any]]):
    """Columns by name. A missing one that is read raises ConfigError with the message's name."""

    def __init__(self, columns: Mapping[str, NDArray[Any]], file: LogFile, topic: str) -> None:
        super().__init__(columns)
        self._file, self._topic = file, topic

    def __missing__(self, name: str) -> NDArray[Any]:
        hint = "the log is damaged, or of another firmware: copy it from the vehicle again"
        raise self._file.refuse(f"has no field {name!r}", hint, topic=self._topic)
