"""Files that a map's file names: only those in a folder of the map, because the map may come from anybody.

A run copies the files of its map into its own folder, and people pass these on. Without this rule a map could take
along any file that the user can read.
"""

from __future__ import annotations

import re
from pathlib import Path

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*:")  # of a URI, and a drive of Windows


def file_below(root: Path, folder: Path, name: str) -> Path:
    """Return the real path of a file below `root` that is named relative to `folder`; it may not exist.

    Raises ValueError, with a message that begins with a verb, for a name that leads out of `root`: an absolute path, a
    URI, `..`, a symbolic link.
    """
    if _SCHEME.match(name):
        raise ValueError(f"is at {name[:80]}: only files of the map's own folder are read")
    if "\\" in name:
        raise ValueError(f"holds a backslash: {name[:80]}: folders are separated by /")
    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # too long; links in a circle; a zero byte
        raise ValueError(f"cannot be a file: {name[:80]!r}: {error}") from None
    if not inside:
        raise ValueError(f"is outside the map's folder: {name[:80]}")
    return path
