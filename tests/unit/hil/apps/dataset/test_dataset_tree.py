"""Files of a data set are written whole or not at all."""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.apps.dataset.storage.tree import TreeWriter
from signals.errors import RecordingError


@pytest.fixture
def tree(tmp_path: Path) -> TreeWriter:
    return TreeWriter(tmp_path)


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_a_written_file_is_complete_and_described(tree: TreeWriter) -> None:
    written = tree.write_parts("deep/down/file", (b"one", b"", b"two"))
    assert (tree.root / "deep/down/file").read_bytes() == b"onetwo"
    assert written == ("deep/down/file", 6, zlib.crc32(b"onetwo"))
    assert tree.holds(written)
    (tree.root / "plain").write_bytes(b"")
    assert (tree.root / "deep/down/file").stat().st_mode == (tree.root / "plain").stat().st_mode


def test_a_new_file_replaces_the_old_one(tree: TreeWriter) -> None:
    (tree.root / ".file.part").write_bytes(b"left by a kill")
    for text in (b"a longer text", b"short"):
        tree.write("file", text)
        assert (tree.root / "file").read_bytes() == text
    tree.write("other", b"")
    assert names(tree.root) == ["file", "other"]


def test_a_failed_write_leaves_the_old_file(tree: TreeWriter) -> None:
    def parts() -> Iterator[bytes]:
        yield b"half of "
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    tree.write("old", b"here before")
    for name in ("old", "new"):
        with pytest.raises(RecordingError, match=f"{name}: cannot be written .No space left"):
            tree.write_parts(name, parts())
    assert (tree.root / "old").read_bytes() == b"here before"
    assert names(tree.root) == ["old"]


def test_a_folder_in_a_files_place_is_reported(tree: TreeWriter) -> None:
    (tree.root / "file").mkdir()
    with pytest.raises(RecordingError, match="file: cannot be written"):
        tree.write("file", b"text")
    assert names(tree.root) == []
