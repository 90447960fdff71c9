"""File of a scene, with the line of every value in it.

A scene holds its file so that later checks, such as those of the map's own files and names, can report 'file:line'.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from signals.documents.document import Document, Place
from signals.documents.validate import at
from signals.errors import Problem

_NOWHERE = Document("scene", None)


@dataclass(frozen=True, eq=False)
class SceneFile:
    """File of a scene. Without `path` (a scene made in a program) relative paths start at the working directory."""

    path: Path | None = None
    document: Document = _NOWHERE
    # Objects made from the scene, by kind, kept so that its files are read once.
    cache: dict[str, Any] = field(default_factory=dict, repr=False)

    # Two scenes with the same values are equal, whatever files they come from.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneFile)

    def __hash__(self) -> int:
        return 0

    @property
    def folder(self) -> Path:
        return self.path.parent if self.path is not None else Path()

    def problem(self, place: Place, message: str, hint: str = "") -> Problem:
        """Return a problem at a place; `message` starts with the verb."""
        return at(self.document, place, message, hint)
