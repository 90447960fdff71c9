"""The database of results under damage, links and other versions: one named error, and nothing is changed."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.run.runs.result_database import Database, UnusableDatabaseError
from signals.errors import RecordingError

TABLES = {"result": "id TEXT PRIMARY KEY, value REAL NOT NULL, text TEXT NOT NULL", "note": "text TEXT"}
ROWS = [(f"case {number:03}", number / 7.0, "{" + "x" * 90 + "}") for number in range(100)]


def opened(path: Path, *, shared: bool = True, version: int = 3) -> Database:
    return Database(path, TABLES, version=version, shared=shared)


def filled(path: Path) -> Path:
    db = opened(path)
    for row in ROWS:
        db.put("result", *row)
    db.close()
    return path


def rows_of(path: Path) -> list[tuple[object, ...]]:
    db = opened(path)
    try:
        return list(db.rows("result"))
    finally:
        db.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return filled(tmp_path_factory.mktemp("whole") / "results.sqlite")


@pytest.mark.parametrize("shared", [True, False])
def test_rows_come_back_and_replace_those_of_the_same_key(tmp_path: Path, shared: bool) -> None:
    path = tmp_path / "a b?#%.sqlite"
    for _ in range(2):
        db = opened(path, shared=shared)
        db.put("result", "b", 1.5, "text")
        db.put("result", "a", float("inf"), "")
        db.close()
    assert rows_of(path) == [("a", float("inf"), ""), ("b", 1.5, "text")]


@pytest.mark.parametrize("seed", range(100))
def test_damage_anywhere_is_told_or_changes_no_row(tmp_path: Path, whole: Path, seed: int) -> None:
    """A byte, a page or the end of the file: what can be read is what was written, and the damage stays as it is."""
    numbers = random.Random(seed)
    data = bytearray(whole.read_bytes())
    at = numbers.randrange(len(data))
    kind = numbers.choice(("cut", "page", "byte", "byte", "header"))
    if kind == "cut":
        del data[at:]
    elif kind == "page":
        page = at // 4096 * 4096
        data[page : page + 4096] = bytes(4096)
    else:
        data[at % 100 if kind == "header" else at] ^= 1 << numbers.randrange(8)
    path = tmp_path / "results.sqlite"
    path.write_bytes(data)
    try:
        rows = rows_of(path)
    except UnusableDatabaseError as error:
        told = str(error)
        rows = None
    if rows is None:
        assert told.startswith(f"{path}: is ")
        assert "use another --out" in told
        assert path.read_bytes() == data
    else:
        assert rows == ROWS


@pytest.mark.parametrize("column", ["id = 'case 0999'", "value = value + 1e-12", "text = text || ' '"])
def test_a_changed_value_is_damage(tmp_path: Path, column: str) -> None:
    path = filled(tmp_path / "results.sqlite")
    with sqlite3.connect(path) as db:
        db.execute(f"UPDATE result SET {column} WHERE id = 'case 050'")
    with pytest.raises(UnusableDatabaseError, match=r"is damaged \(a row of the table result has another checksum\)"):
        opened(path)


@pytest.mark.parametrize("statement", ["DROP TABLE note", "CREATE TABLE more (x)", "CREATE INDEX i ON note (text)"])
def test_other_tables_are_damage(tmp_path: Path, statement: str) -> None:
    path = filled(tmp_path / "results.sqlite")
    with sqlite3.connect(path) as db:
        db.execute(statement)
    with pytest.raises(UnusableDatabaseError, match="its tables are not those of the bench"):
        opened(path)


def test_another_version_is_told(tmp_path: Path) -> None:
    path = filled(tmp_path / "results.sqlite")
    with pytest.raises(UnusableDatabaseError, match="is of version 3 of the results, this hil-bench reads 4"):
        opened(path, version=4)


def _fifo(path: Path, other: Path) -> None:
    os.mkfifo(path)


def _device(path: Path, other: Path) -> None:
    os.mknod(path, 0o20600, os.makedev(1, 3))


@pytest.mark.parametrize("suffix", ["", "-wal", "-shm", "-journal", ".part"])
@pytest.mark.parametrize(
    ("place", "what"),
    [
        (Path.symlink_to, "a link"),
        (Path.hardlink_to, "a hard link"),
        (lambda path, _: path.symlink_to("nowhere"), "a link"),
        (lambda path, _: path.mkdir(), "a folder"),
        (_fifo, "a FIFO"),
        pytest.param(_device, "a device", marks=pytest.mark.skipif(os.getuid() != 0, reason="only root makes devices")),
    ],
)
def test_only_files_of_their_own_are_opened(
    tmp_path: Path, suffix: str, place: Callable[[Path, Path], None], what: str
) -> None:
    other = filled(tmp_path / "other.sqlite")
    before = other.read_bytes()
    path = tmp_path / f"results.sqlite{suffix}"
    try:
        place(path, other)
    except PermissionError:
        pytest.skip("this container may not make devices")
    with pytest.raises(RecordingError, match=f"is {what}, not a file of its own"):
        opened(tmp_path / "results.sqlite")
    assert other.read_bytes() == before


def test_journals_left_by_another_process(tmp_path: Path) -> None:
    """Journals of a killed process are read, others are ignored or refused."""
    path = tmp_path / "results.sqlite"
    db = opened(path)
    for row in ROWS:
        db.put("result", *row)
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in tmp_path.glob("results.sqlite*"):
        shutil.copy(file, killed)
    db.close()
    assert (killed / "results.sqlite-wal").stat().st_size > 0
    assert rows_of(killed / "results.sqlite") == ROWS
    for name, content in (("-wal", b"\x37\x7f\x06\x82" + b"x" * 9000), ("-shm", b"x" * 99)):
        copy = Path(shutil.copy(path, tmp_path / f"left{name}.sqlite"))
        copy.with_name(copy.name + name).write_bytes(content)
        assert rows_of(copy) == ROWS
    (tmp_path / "results.sqlite-journal").write_bytes(b"")
    with pytest.raises(UnusableDatabaseError, match=r"results.sqlite-journal beside it was left by another program"):
        opened(path)


def test_a_full_disk_is_no_damage(tmp_path: Path) -> None:
    path = filled(tmp_path / "results.sqlite")
    db = opened(path)
    db.do("PRAGMA max_page_count = 1")
    with pytest.raises(RecordingError, match=r"cannot be written \(database or disk is full\).*continue with --resume"):
        db.put("result", "more", 0.0, "x" * 100_000)
    db.close()
    assert rows_of(path)[: len(ROWS)] == ROWS
