"""The verdict of one judge of a flight, or of several together: rows of measurements, and reasons why it fails."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from signals.errors import HilError

# Of ground truth, for all judges.
AIRBORNE_M = 0.3  # height above the start
REST_SPEED_MPS = 0.3
REST_CONTACT_NS = 500_000_000  # a vehicle at rest touched the ground within this time


@dataclass(frozen=True)
class Row:
    """One measurement beside its limit. `limit` None: not judged, or judged by a part in its own way."""

    name: str
    value: float | None
    limit: float | None
    unit: str
    ok: bool

    def as_map(self) -> dict[str, Any]:
        """Return the fields for run.json. `ok` is None where nothing was measured or called for."""
        judged = self.value is not None or not self.ok
        return {**vars(self), "ok": self.ok if judged else None}


def rows_within(*measured: tuple[str, float | None, float | None, str, bool]) -> tuple[list[Row], list[str]]:
    """Return measurements as rows, and the reasons why some fail.

    Each measurement is name, value, limit, unit, and True if the limit is a minimum.
    """
    rows, reasons = [], []
    for name, value, limit, unit, is_minimum in measured:
        ok = limit is None or (value is not None and (value >= limit if is_minimum else value <= limit))
        rows.append(Row(name, value, limit, unit, ok))
        if not ok:
            was = "was never measured" if value is None else f"is {value:.3g} {unit}".rstrip()
            reasons.append(f"{name} {was}, {'at least' if is_minimum else 'at most'} {limit:g} {unit}".rstrip())
    return rows, reasons


@dataclass(frozen=True)
class Verdict:
    """Result of one judge of a flight, or of several together: PASS, or FAIL with every reason.

    Judges never see each other's verdicts, and `together` keeps whatever each of them says, so none can take away what
    another found. A row that is not ok is a reason, too, where its judge names none.
    """

    rows: Sequence[Row] = ()
    reasons: Sequence[str] = ()
    causes: Sequence[str] = ()  # reasons from which those of all judges follow, such as a crash

    def __post_init__(self) -> None:
        reasons = (*self.causes, *(reason for reason in self.reasons if reason not in self.causes))
        if not reasons:
            reasons = tuple(f"{row.name} is {_value_text(row)}: not ok" for row in self.rows if not row.ok)
        object.__setattr__(self, "rows", tuple(self.rows))
        object.__setattr__(self, "reasons", reasons)
        object.__setattr__(self, "causes", tuple(self.causes))

    @property
    def status(self) -> Literal["PASS", "FAIL"]:
        """FAIL if there is any reason."""
        return "FAIL" if self.reasons else "PASS"

    @staticmethod
    def together(verdicts: Iterable[Verdict]) -> Verdict:
        """Return the rows and reasons of all verdicts in their order, the causes before all other reasons.

        Raises HilError for two rows of one name, of which readers by name would see only one.
        """
        all_of = tuple(verdicts)
        rows = tuple(row for verdict in all_of for row in verdict.rows)
        repeated = next((name for name, count in Counter(row.name for row in rows).items() if count > 1), None)
        if repeated is not None:
            raise HilError(f"two measurements of the verdict are called {repeated!r}: give one of them another name")
        return Verdict(
            rows,
            tuple(reason for verdict in all_of for reason in verdict.reasons),
            tuple(cause for verdict in all_of for cause in verdict.causes),
        )


def _value_text(row: Row) -> str:
    return "not measured" if row.value is None else f"{row.value:.3g} {row.unit}".rstrip()
