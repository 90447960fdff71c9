"""Tables of a campaign: results.csv, results.jsonl and campaign.json.

They hold nothing that depends on the machine, the number of workers or the order in which flights ended, so the same
cases give the same bytes. campaign.json has further keys that do.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.store import Case
from hil.run.report.run_json import write_run_json
from signals.errors import file_errors

CSV_NAME, LINES_NAME = "results.csv", "results.jsonl"
Sink = Callable[[Case], object]  # writes one case
# A spreadsheet takes a cell that begins so for a formula (OWASP, CSV injection; the last four are full-width), but a
# number for a number.
_FORMULA = re.compile("[=+\\-@\\t\\n\uff1d\uff0b\uff0d\uff20]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_FIRST, _LAST = ("case", "status"), ("margin", "worst_limit", "reason", "digest")


def csv_row(case: Case) -> dict[str, Any]:
    """Return a case as a row of results.csv: axes, measurements, the smallest margin and its limit."""
    outcome, worst = case.outcome, case.outcome.worst
    return {
        "case": case.id,
        "status": case.status,
        **{limit.name: _cell(limit.value) for limit in outcome.limits},
        **{axis: _cell(value) for axis, value in case.axes.items()},  # an axis of the same name has the column
        "margin": _cell(None if worst is None else worst.margin),
        "worst_limit": _cell(None if worst is None else worst.name),
        "reason": _cell(case.reason),
        "digest": outcome.digest if outcome.repeatable else "",
    }


def _cell(value: Any) -> Any:
    """Return a value as a cell; a text that a spreadsheet would run gets an apostrophe before it."""
    if value is None:
        return ""
    if isinstance(value, str):
        text = re.sub("\r\n?", "\n", value)  # the writer does not quote a return, which would begin another row
        return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text
    return json.dumps(value, sort_keys=True) if isinstance(value, list | dict | bool) else value


@contextmanager
def csv_rows(path: Path, axes: Iterable[str], measurements: Iterable[str]) -> Iterator[Sink]:
    """Return what writes a case as a row of results.csv. Raises RecordingError."""
    columns = [*_FIRST, *axes, *(name for name in measurements if name not in set(axes)), *_LAST]
    with written(path) as file:
        writer = csv.DictWriter(file, columns, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writerow({column: _cell(column) for column in columns})
        yield lambda case: writer.writerow(csv_row(case))


@contextmanager
def json_lines(path: Path) -> Iterator[Sink]:
    """Return what writes a case as a line of results.jsonl, with settings and all limits. Raises RecordingError."""
    with written(path) as file:
        yield lambda case: file.write(json.dumps(_line(case), ensure_ascii=False) + "\n")


def _line(case: Case) -> dict[str, Any]:
    outcome = case.outcome
    return {
        "case": case.id,
        "status": case.status,
        "axes": dict(case.axes),
        "reason": case.reason,
        "error": outcome.error or None,
        "flown": outcome.flown,
        "limits": [{**vars(limit), "margin": limit.margin} for limit in outcome.limits],
        "digest": outcome.digest if outcome.repeatable else None,
        "sim_s": outcome.sim_s,
        "set": list(case.texts),
    }


def write_each(cases: Iterable[Case], *files: AbstractContextManager[Sink]) -> None:
    """Write all cases into all files in one pass. Raises RecordingError."""
    with ExitStack() as stack:
        sinks = [stack.enter_context(file) for file in files]
        for case in cases:
            for write in sinks:
                write(case)


def write_summary(path: Path, tally: Tally, more: Mapping[str, Any]) -> None:
    """Write campaign.json. Raises RecordingError."""
    counts = {"cases": tally.cases, "pass": tally.passed, "fail": tally.failed, "error": tally.errors}
    rate = list(tally.interval())
    write_run_json(path, {"schema": 1, **counts, "flake": tally.flakes, "pass_rate": rate, **more})


KEPT = ". The flights are stored; continue with --resume"


@contextmanager
def written(path: Path) -> Iterator[TextIOWrapper]:
    """Write a file as a whole: a reader sees the old one or the new one. Raises RecordingError."""
    temporary = path.with_name(path.name + ".part")
    with file_errors(path, hint=KEPT):
        with temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
            yield file
        temporary.replace(path)
