"""The results of a campaign: an SQLite file with one row for each case, and the plan that asks for them.

A case is stored once, whatever plans have asked for it: a plan that changes, or one with more samples, finds what was
flown before. Only the process of the campaign writes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from hil.apps.campaign.flight import Outcome
from hil.run.runs.result_database import Database
from signals.errors import file_errors

STORE_NAME = "campaign.sqlite"
_VERSION = 2  # of the tables below
_TABLES = {
    "flown": "id TEXT PRIMARY KEY, status TEXT NOT NULL, outcome TEXT NOT NULL, texts TEXT NOT NULL",
    "checked": "id TEXT PRIMARY KEY, digest TEXT NOT NULL, difference TEXT NOT NULL",
    "point": "number INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, axes TEXT NOT NULL",
    "base": "bench TEXT, texts TEXT NOT NULL",
}
# The points of the plan with their outcomes and, where they were flown twice, the second digests.
_ROWS = """
SELECT p.id, p.number, p.axes, f.outcome, f.texts, c.digest, c.difference
FROM point p JOIN flown f ON f.id = p.id LEFT JOIN checked c ON c.id = p.id ORDER BY {order}
"""


@dataclass(frozen=True)
class Case:
    """One case of the plan with its outcome. `difference`: to its second flight, empty if there is none."""

    id: str
    number: int  # of its first point in the plan
    axes: Mapping[str, Any]
    outcome: Outcome
    texts: tuple[str, ...]
    second_digest: str | None = None
    difference: str = ""

    @property
    def status(self) -> str:
        """PASS, FAIL, ERROR, or FLAKE: a second flight had another digest."""
        return "FLAKE" if self.difference else self.outcome.status

    @property
    def reason(self) -> str:
        """The limits that were not met, the type of the error, or the first difference of two flights; else empty."""
        if self.difference:
            return self.difference
        return self.outcome.error_type or "; ".join(self.outcome.reasons)


class Store:
    """The results in a folder. Use as a context manager. Every method raises RecordingError."""

    def __init__(self, folder: Path) -> None:
        with file_errors(folder, "cannot be made"):
            folder.mkdir(parents=True, exist_ok=True)
        self._db = Database(folder / STORE_NAME, _TABLES, version=_VERSION, shared=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    def begin_plan(self, bench: Path | None = None, texts: Sequence[str] = ()) -> None:
        """Forget the points of an earlier plan; the flown cases stay.

        `bench` is the file of the base bench, `texts` the settings of all points as texts of `--set`.
        """
        self._db.do("DELETE FROM point")
        self._db.do("DELETE FROM base")
        self._db.put("base", None if bench is None else str(bench.resolve()), json.dumps(texts))

    def base(self) -> tuple[Path | None, tuple[str, ...]] | None:
        """Return the file of the base bench and the settings of all points; None: the folder never had a plan."""
        found = self._db.do("SELECT bench, texts FROM base")
        return (Path(found[0][0]) if found[0][0] else None, tuple(json.loads(found[0][1]))) if found else None

    def flown(self, prefix: str) -> list[tuple[str, Outcome, tuple[str, ...]]]:
        """Return identity, outcome and settings of all flown cases, of the plan or not, that begin with `prefix`."""
        rows = self._db.do("SELECT id, outcome, texts FROM flown WHERE substr(id, 1, ?) = ?", len(prefix), prefix)
        return [(case, Outcome.from_data(json.loads(data)), tuple(json.loads(texts))) for case, data, texts in rows]

    def add_point(self, number: int, case: str, axes: Mapping[str, Any]) -> bool:
        """Add a point of the plan. Returns False if the plan has a point of this case already."""
        if self._db.do("SELECT 1 FROM point WHERE id = ?", case):
            return False
        self._db.put("point", number, case, json.dumps(dict(axes)))
        return True

    def cut(self, number: int) -> None:
        """Take all points after `number` out of the plan; their results stay."""
        self._db.do("DELETE FROM point WHERE number > ?", number)

    def outcome(self, case: str) -> Outcome | None:
        """Return the outcome of a case, None if it was never flown."""
        found = self._db.do("SELECT outcome FROM flown WHERE id = ?", case)
        return Outcome.from_data(json.loads(found[0][0])) if found else None

    def status(self, case: str) -> str | None:
        """Return the status of a case's first flight, None if it was never flown."""
        found = self._db.do("SELECT status FROM flown WHERE id = ?", case)
        return found[0][0] if found else None

    def put(self, case: str, outcome: Outcome, texts: tuple[str, ...]) -> None:
        """Store the outcome of a case, in place of an earlier one."""
        self._db.put("flown", case, outcome.status, json.dumps(outcome.data()), json.dumps(texts))

    def put_check(self, case: str, digest: str, difference: str) -> None:
        """Store the digest of a second flight, and its first difference, empty if there is none."""
        self._db.put("checked", case, digest, difference)

    def difference(self, case: str) -> str:
        """Return the first difference of a case's two flights; empty if there is none, or no second flight."""
        found = self._db.do("SELECT difference FROM checked WHERE id = ?", case)
        return found[0][0] if found else ""

    def cases(self, *, by_plan: bool = False) -> Iterator[Case]:
        """Return the flown cases of the plan one by one, sorted by case, or in the order of the plan."""
        order = "p.number" if by_plan else "p.id"
        for case, number, axes, outcome, texts, second, difference in self._db.each(_ROWS.format(order=order)):
            flown, settings = Outcome.from_data(json.loads(outcome)), tuple(json.loads(texts))
            yield Case(case, number, json.loads(axes), flown, settings, second, difference or "")
