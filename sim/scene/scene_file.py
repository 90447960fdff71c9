"""Where a scene was written: its file, and the line of everything in it.

A scene carries this so that whoever looks further, at the map's own files and names, can say 'file:line'.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hil.signals.errors import Problem

Place = tuple[str | int, ...]


@dataclass(frozen=True, eq=False)
class SceneFile:
    """`path` is None for a scene made in a program; relative paths in it then start at the working directory."""

    path: Path | None = None
    source: str = "scene"  # the file as it is named to people
    lines: Mapping[Place, int] = field(default_factory=dict)
    # What was made of the scene, by whoever made it; a scene's files are read once.
    made: dict[str, Any] = field(default_factory=dict, repr=False)

    # A scene is what it says, wherever it was written: this part of it never makes two scenes differ.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneFile)

    def __hash__(self) -> int:
        return 0

    @property
    def folder(self) -> Path:
        return self.path.parent if self.path is not None else Path()

    def where(self, place: Place) -> str:
        """'file:line' of a place, or of the nearest thing that encloses it."""
        for length in range(len(place), -1, -1):
            line = self.lines.get(place[:length])
            if line is not None:
                return f"{self.source}:{line}"
        return self.source

    def problem(self, place: Place, message: str, hint: str = "") -> Problem:
        """A problem at a place; `message` starts with the verb."""
        name = ""
        for part in place:
            name += f"[{part}]" if isinstance(part, int) else (f".{part}" if name else part)
        return Problem(self.where(place), f"{name} {message}" if name else message, hint)


def shown(path: Path) -> str:
    """`path` as a person at this working directory would write it."""
    try:
        return path.resolve().relative_to(Path.cwd()).as_posix()
    except (ValueError, OSError, RuntimeError):
        return str(path)
