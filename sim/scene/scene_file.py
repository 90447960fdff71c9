"""Where a scene was written: its file, and the line of everything in it.

A scene carries this so that whoever looks further, at the map's own files and names, can say 'file:line'.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hil.signals.documents.document import Document, Place
from hil.signals.documents.validate import at
from hil.signals.errors import Problem

_NOWHERE = Document("scene", None)


@dataclass(frozen=True, eq=False)
class SceneFile:
    """`path` is None for a scene made in a program; relative paths in it then start at the working directory."""

    path: Path | None = None
    document: Document = _NOWHERE
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

    def problem(self, place: Place, message: str, hint: str = "") -> Problem:
        """A problem at a place; `message` starts with the verb."""
        return at(self.document, place, message, hint)
