"""A parsed file with the line of every value."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from signals.errors import ConfigError

Place = tuple[str | int, ...]
"""Path of a value inside a document: keys of mappings and indices of lists, () for the whole."""


@dataclass(frozen=True)
class Document:
    """Plain data (dict, list, str, int, float, bool, None) and the line of every value.

    `source` is the file as shown in messages. The line of a mapping's entry is the line of its key; the line of a
    list's entry is where the entry starts. Lines count from 1.
    """

    source: str
    data: Any
    lines: Mapping[Place, int] = field(default_factory=dict)

    def where(self, place: Place) -> str:
        """Return 'file:line' of a place, or of the nearest value that encloses it."""
        for length in range(len(place), -1, -1):
            line = self.lines.get(place[:length])
            if line is not None:
                return f"{self.source}:{line}"
        return self.source

    def covers(self, place: Place) -> bool:
        """Return True if the document contains a value at this place, with its line."""
        return place in self.lines


def shown_path(path: Path) -> str:
    """Return `path` relative to the working directory if it lies in it, else unchanged."""
    try:
        return path.resolve().relative_to(Path.cwd()).as_posix()
    except (ValueError, OSError, RuntimeError):  # outside it; no working directory; symbolic links in a circle
        return str(path)


def read_text(path: Path, *, limit_bytes: int) -> str:
    """Return the text of a user's file. Raises ConfigError if it is missing, too large, binary or not UTF-8."""
    source = shown_path(path)
    try:
        if path.is_dir():
            raise ConfigError.at(source, "is a folder, not a file")
        # A pipe or a device may have no end.
        if not stat.S_ISREG(path.stat().st_mode):
            raise ConfigError.at(source, "is not a regular file but a device, a pipe or a socket")
        with path.open("rb") as file:
            raw = file.read(limit_bytes + 1)
            size = max(len(raw), os.fstat(file.fileno()).st_size)
        if len(raw) > limit_bytes:
            message = f"is {size / 1e6:.1f} MB long, more than the {limit_bytes / 1e6:g} MB that are read"
            raise ConfigError.at(source, message, "is it the file you meant?")
    except FileNotFoundError:
        raise ConfigError.at(source, "no such file") from None
    except OSError as error:
        raise ConfigError.at(source, f"cannot be read: {error.strerror}") from None
    except ValueError as error:  # a zero byte in the name
        raise ConfigError.at(source, f"cannot be read: {error}") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"is not text: byte 0x{raw[error.start]:02x} is not UTF-8"
        raise ConfigError.at(f"{source}:{line}", message) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ConfigError.at(f"{source}:{line}", "is a binary file, not text")
    return text
