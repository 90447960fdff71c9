"""SQLite file of results from which a later process continues: every row has a checksum, all damage has one error.

SQLite finds damage of its own structures but not of the values in them, and it follows links. Here the tables must be
the expected ones, each row ends with the CRC-32 of its values, and the file and its journals are plain files. What was
written survives a crash of the process; after the next checkpoint of SQLite, also a power cut.
"""

from __future__ import annotations

import os
import sqlite3
import stat
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from isal.isal_zlib import crc32

from signals.errors import RecordingError

_NEW = ".part"  # a file is made under this name, so that an empty one under its own is always damage
_FOREIGN = "-journal"  # of a database without write-ahead log, which this one never is
_COMPANIONS = ("", _NEW, "-wal", "-shm", _FOREIGN)  # suffixes of the files that SQLite opens
_CHECKSUM = "crc32 INTEGER NOT NULL"
# Primary codes of errors that are not damage. READONLY is, if the file can be written: the header forbids it.
_OUTSIDE = frozenset(
    (
        *(sqlite3.SQLITE_PERM, sqlite3.SQLITE_ABORT, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_NOMEM),
        *(sqlite3.SQLITE_INTERRUPT, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL, sqlite3.SQLITE_CANTOPEN),
        *(sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_MISUSE, sqlite3.SQLITE_NOLFS, sqlite3.SQLITE_AUTH),
    )
)


class UnusableDatabaseError(RecordingError):
    """Database of another version, or whose tables or rows are not as they were written. It was not changed."""


class Database:
    """One file, written by one process. Every method raises RecordingError."""

    def __init__(self, path: Path, tables: Mapping[str, str], *, version: int, shared: bool) -> None:
        """Open the file, or make one if there is none, with `tables`: the columns of each, as in SQL.

        `shared`: other processes may read it meanwhile, and all rows are checked before anything is written. Otherwise
        it is locked without shared memory, which network file systems lack, and rows are checked as they are read.
        Raises UnusableDatabaseError for damage and for another version of the tables.
        """
        self._path = path
        self._tables = {name: f"CREATE TABLE {name} ({columns}, {_CHECKSUM})" for name, columns in tables.items()}
        self._version = version
        for suffix in _COMPANIONS:
            require_plain(path.with_name(path.name + suffix))
        if path.with_name(path.name + _FOREIGN).exists():  # SQLite would write it back into the file
            raise self._damaged(f"{path.name}{_FOREIGN} beside it was left by another program")
        with self._told():
            if not path.exists():
                self._make()
            if shared:
                with closing(self._connected("ro")) as self._db:
                    self._check_structure()
                    for name in tables:
                        deque(self.rows(name), 0)
            self._db = self._connected("rw")
            try:
                if not shared:
                    self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
                    self._check_structure()
                self._db.execute("PRAGMA synchronous = NORMAL")
                self._db.execute(f"PRAGMA user_version = {version}")  # fails if the header forbids writing
            except BaseException:
                self._db.close()
                raise

    def put(self, table: str, *values: Any) -> None:
        """Store a row, in place of one with the same key. Values: str, bytes, int, float or None."""
        marks = ", ".join("?" * (len(values) + 1))
        self.do(f"INSERT OR REPLACE INTO {table} VALUES ({marks})", *values, _checksum(values))  # noqa: S608 (own names)

    def rows(self, table: str) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a table in the order of their keys, each checked."""
        for row in self.each(f"SELECT * FROM {table} ORDER BY 1"):  # noqa: S608 (own names)
            if row[-1] != _checksum(row[:-1]):
                raise self._damaged(f"a row of the table {table} has another checksum")
            yield row[:-1]

    def each(self, statement: str) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a statement as they are found."""
        with self._told():
            for row in self._db.execute(statement):  # noqa: UP028 (that would close the cursor, maybe after the file)
                yield row

    def do(self, statement: str, *values: Any) -> list[Any]:
        """Carry out a statement and return its rows."""
        with self._told():
            return self._db.execute(statement, values).fetchall()

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._db.close()

    def _make(self) -> None:
        new = self._path.with_name(self._path.name + _NEW)
        new.unlink(missing_ok=True)
        with closing(sqlite3.connect(new, isolation_level=None)) as db:
            db.execute("PRAGMA journal_mode = WAL")
            for statement in self._tables.values():
                db.execute(statement)
            db.execute(f"PRAGMA user_version = {self._version}")
        new.replace(self._path)

    def _connected(self, mode: str) -> sqlite3.Connection:
        name = quote(os.fsencode(self._path.absolute()))
        return sqlite3.connect(f"file:{name}?mode={mode}", uri=True, isolation_level=None)

    def _check_structure(self) -> None:
        ((version,),) = self.do("PRAGMA user_version")
        if version not in (0, self._version):
            text = f"is of version {version} of the results, this hil-bench reads {self._version}"
            raise UnusableDatabaseError(f"{self._path}: {text}; use another --out")
        # A damaged description of a table may still be valid SQL with another meaning.
        tables = dict(self.do("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL"))
        if tables != self._tables:
            raise self._damaged("its tables are not those of the bench")
        ((found,),) = self.do("PRAGMA integrity_check(1)")
        if found != "ok":
            raise self._damaged(" ".join(found.split()))

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Raise UnusableDatabaseError or RecordingError for an error of SQLite or the system."""
        try:
            yield
        except OSError as error:
            raise RecordingError(f"{self._path}: cannot be used ({error.strerror or error})") from error
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
            read_only = code == sqlite3.SQLITE_READONLY and not os.access(self._path, os.W_OK)
            if code not in _OUTSIDE and not read_only:
                raise self._damaged(str(error)) from error
            raise RecordingError(
                f"{self._path}: cannot be written ({self._reason(error, code)}). Everything stored so far is kept; "
                "free some space or choose another folder, then continue with --resume"
            ) from error

    def _damaged(self, what: str) -> UnusableDatabaseError:
        return UnusableDatabaseError(
            f"{self._path}: is damaged ({what}), so its results cannot be trusted; it was left as it is. "
            "Put back a copy of it, or use another --out"
        )

    def _reason(self, error: sqlite3.Error, code: int) -> str:
        """Return what SQLite says, or what the system says about a file that SQLite cannot open."""
        if code == sqlite3.SQLITE_CANTOPEN:
            try:
                os.close(os.open(self._path, os.O_RDONLY))
            except OSError as problem:
                return problem.strerror or str(problem)
        return str(error)


def require_plain(path: Path) -> None:
    """Check that a path is free or a file of its own. Raises RecordingError for links, folders, FIFOs and devices."""
    try:
        state = path.lstat()
    except OSError:
        return  # there is none, or opening it will tell
    kinds = {stat.S_IFLNK: "a link", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a FIFO", stat.S_IFREG: "a hard link"}
    if stat.S_ISREG(state.st_mode) and state.st_nlink == 1:
        return
    what = kinds.get(stat.S_IFMT(state.st_mode), "a device")
    raise RecordingError(f"{path}: is {what}, not a file of its own; remove it, or use another --out")


def _checksum(values: tuple[Any, ...]) -> int:
    crc = 0
    for value in values:
        data = value if isinstance(value, bytes) else repr(value).encode()
        crc = crc32(data, crc32(b"%d:" % len(data), crc))
    return crc
