"""Trees: archives of files that a node unpacks once, in a folder named by their hash."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import tarfile
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from signals.errors import RecordingError, file_errors


def user_folder() -> Path:
    """Return a folder for temporary files that only this user can write. Raises RecordingError."""
    folder = Path(tempfile.gettempdir()) / f"hil-{os.getuid()}"
    with file_errors(folder, "cannot be used for temporary files", hint="; set TMPDIR"):
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            raise RecordingError(f"{folder}: belongs to another user; remove it, or set TMPDIR")
    return folder


def trees_folder() -> Path:
    """Return the folder of this machine for unpacked trees. Raises RecordingError, OSError."""
    trees = user_folder() / "trees"
    trees.mkdir(exist_ok=True)
    return trees


def unpack_trees(names: Iterable[str], archives: Mapping[str, Any]) -> Path:
    """Unpack trees on a node and return their folder; `archives` holds references of Ray. Raises RecordingError."""
    trees = trees_folder()
    for name in names:
        unpack_tree(name, trees, lambda name=name: _content(archives[name]))  # type: ignore[misc]
    return trees


def _content(reference: Any) -> bytes:
    import ray

    return bytes(ray.get(reference))


def unpack_tree(name: str, trees: Path, content: Callable[[], bytes]) -> None:
    """Unpack a tree unless an earlier job has done so; `content` returns the archive. Raises RecordingError."""
    if (trees / name).is_dir():
        return
    archive, part = content(), None
    try:
        part = Path(tempfile.mkdtemp(prefix=f"{name}.", dir=trees))
        unpack(archive, part)
        os.rename(part, trees / name)
    except OSError as error:
        if part is not None:
            shutil.rmtree(part, ignore_errors=True)
        if not (trees / name).is_dir():  # otherwise another process was first
            reason = error.strerror or error
            raise RecordingError(f"{trees}: files of a bench cannot be unpacked here ({reason})") from error


def tree_name(archive: bytes) -> str:
    """Return the name of a tree: the hash of its archive."""
    return hashlib.blake2b(archive, digest_size=16).hexdigest()


def packed(entries: Iterable[tuple[Path, str]]) -> bytes:
    """Return an archive that depends on names, modes and contents alone."""

    def plain(member: tarfile.TarInfo) -> tarfile.TarInfo:
        member.mtime, member.uid, member.gid, member.uname, member.gname = 0, 0, 0, "", ""
        return member

    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for path, name in sorted(entries):
            archive.add(path, name, filter=plain)
    return buffer.getvalue()


def packed_files(files: Mapping[str, bytes]) -> bytes:
    """Return an archive of files by their names."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for name, content in sorted(files.items()):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return buffer.getvalue()


def unpack(archive: bytes, folder: Path) -> None:
    """Unpack an archive into a folder."""
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
