"""Views that clients send for display: the newest of each for the dashboard, and all in a file for its replay.

`companion_views.jsonl`: one line per view in the order of arrival. The file is bounded in size and does not affect the
flight: after the first failed write nothing more is written, and the run goes on.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from firmware_bridge.codecs.companion_view import View, view_from_map
from firmware_bridge.codecs.errors import CodecError
from hil.run_files import VIEWS_NAME
from signals.time import NS_PER_S

VIEWS_EVERY_NS = NS_PER_S // 2  # simulated time
_MAX_BYTES = 64 << 20  # size of the file
_BINARY_FIELDS = ("plan_W", "particles_W")


@dataclass
class ViewLog:
    """Views of one run. The first view creates the file."""

    folder: Path
    newest: dict[str, View] = field(default_factory=dict)  # by client
    _file: TextIO | None = None
    _written: int = 0
    _ended: bool = False

    def begin(self) -> None:
        """Remove the file of an earlier run in the same folder."""
        with suppress(OSError):
            (self.folder / VIEWS_NAME).unlink(missing_ok=True)

    def take(self, client: str, view: View) -> None:
        """Store a view of a client; ignores views that come earlier than the requested period."""
        previous = self.newest.get(client)
        if previous is not None and 0 <= view.t_ns - previous.t_ns < VIEWS_EVERY_NS:
            return
        self.newest[client] = view
        if self._ended:
            return
        line = json.dumps({"client": client} | _as_json(view), separators=(",", ":")) + "\n"
        self._written += len(line)
        try:
            if self._file is None:
                self._file = (self.folder / VIEWS_NAME).open("w", encoding="utf-8")
            if self._written <= _MAX_BYTES:
                self._file.write(line)
                return
        except OSError:
            pass
        self._ended = True
        self.close()

    def close(self) -> None:
        """Close the file. Idempotent."""
        file, self._file = self._file, None
        self._ended = self._ended or file is not None
        if file is not None:
            with suppress(OSError):
                file.close()


def read_views(path: Path) -> Iterator[tuple[str, View]]:
    """Yield client and view of each line, up to the first unreadable one; nothing without a file."""
    try:
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                values = json.loads(line)
                client = values.pop("client")
                yield str(client), view_from_map(_from_json(values))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, CodecError):
        return


def _as_json(view: View) -> dict[str, Any]:
    values = view._asdict()
    values |= {name: base64.b64encode(values[name]).decode("ascii") for name in _BINARY_FIELDS}
    if view.map is not None:
        values["map"] = view.map._asdict() | {"cells": base64.b64encode(view.map.cells).decode("ascii")}
    return values


def _from_json(values: dict[str, Any]) -> dict[str, Any]:
    values |= {name: base64.b64decode(values[name]) for name in _BINARY_FIELDS}
    if values["map"] is not None:
        values["map"]["cells"] = base64.b64decode(values["map"]["cells"])
    return values
