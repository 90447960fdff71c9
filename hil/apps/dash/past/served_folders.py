"""Folders of results of which the page shows files: names and paths in requests come from anybody."""

from __future__ import annotations

import re
from pathlib import Path

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,120}\Z")
_MAX_FOLDERS = 500
_SERVED_SUFFIXES = frozenset({".html", ".png", ".json", ".yaml", ".csv", ".svg", ".jpg"})
_MAX_FILE_BYTES = 64 << 20


class ServedFolders:
    """The folders in one folder. Its methods read files: call them in a thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def folders(self) -> list[Path]:
        """Return the last 500 folders by name, backwards; runs are named by their time."""
        try:
            folders = [p for p in self._folder.iterdir() if p.is_dir() and not p.is_symlink() and _NAME.match(p.name)]
        except OSError:
            return []
        return sorted(folders, key=lambda p: p.name, reverse=True)[:_MAX_FOLDERS]

    def folder(self, name: str) -> Path | None:
        """Return the folder of that name, always inside the served one; None if there is no such folder."""
        if not _NAME.match(name):
            return None
        folder = self._folder / name
        return folder if folder.is_dir() and not folder.is_symlink() else None

    def file(self, name: str, path: str) -> Path | None:
        """Return a file of the folder's report; None for any other file."""
        folder = self.folder(name)
        if folder is None:
            return None
        try:
            file = (folder / path).resolve()
            inside = file.is_relative_to(folder.resolve()) and file.is_file()
        except (OSError, ValueError, RuntimeError):
            return None
        if not inside or file.suffix.lower() not in _SERVED_SUFFIXES or file.stat().st_size > _MAX_FILE_BYTES:
            return None
        return file
