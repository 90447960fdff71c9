"""Files of a campaign: its tables, JUnit and page at the end, and campaign.json while it goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hil.apps.campaign.campaign import Campaign, Progress
from hil.apps.campaign.identity import program_digest
from hil.apps.campaign.results import tables
from hil.apps.campaign.results.groups import groups_of
from hil.apps.campaign.results.junit import JUNIT_NAME, junit_cases
from hil.apps.campaign.results.page import Facts, write_page
from hil.apps.campaign.results.summary import Summary
from hil.run_files import SUMMARY_NAME
from signals.errors import ConfigError

_LIVE_PERIOD_S = 2.0  # between two campaign.json of a campaign that goes on


class LiveSummary:
    """Shows the progress of a campaign or a search, and writes it to campaign.json every few seconds."""

    def __init__(self, out: Path, show: Callable[[Progress], None], facts: Callable[[], Mapping[str, Any]]) -> None:
        """`facts`: returns further keys of campaign.json."""
        self._path, self._show, self._facts = out / SUMMARY_NAME, show, facts
        self._next_s = 0.0

    def __call__(self, state: Progress) -> None:
        self._show(state)
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + _LIVE_PERIOD_S
            doing = {"phase": state.phase, "done": state.done, "total": state.total}
            more = {**self._facts(), "exit_status": None, "complete": False, "doing": doing}
            tables.write_summary(self._path, state.tally, more)


def write_results(campaign: Campaign) -> Summary:
    """Write all tables and the page of a campaign, complete or not. Return its statistics; raises RecordingError."""
    store, out, file = campaign.store, campaign.out, campaign.file
    summary = Summary.of(groups_of(file.spec), store.cases())
    tally, name, bench = summary.tally, file.name, file.bench_path
    complete = not campaign.stopped and not campaign.unfinished
    tables.write_each(
        store.cases(),
        tables.csv_rows(out / tables.CSV_NAME, campaign.plan.axes, sorted(summary.limits)),
        tables.json_lines(out / tables.LINES_NAME),
        junit_cases(out / JUNIT_NAME, name, summary, bench),
    )
    ended = {"complete": complete, "doing": None, "stopped": campaign.stopped or None}
    more = {**facts_of(campaign), "exit_status": tally.exit_status, **ended, **summary.data()}
    tables.write_summary(out / SUMMARY_NAME, tally, more)
    points, flown, stopped = len(campaign.plan), campaign.flown, campaign.stopped
    wall_s = time.monotonic() - campaign.began_s
    facts = Facts(name, file.spec.description, out, bench, points, stopped, complete, flown, wall_s)
    write_page(facts, summary)
    return summary


def check_name(folder: Path, name: str) -> None:
    """Check that a folder holds no campaign or search of another name. Raises ConfigError."""
    try:
        other = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))["name"]
    except (OSError, ValueError, LookupError, TypeError):
        return  # the folder is new, or was left before anything was written
    if other != name:
        message = f"holds {other!r}, and this is {name!r}: a file of that name continues it"
        raise ConfigError.at(str(folder), message, "name another folder with --out")


def facts_of(campaign: Campaign) -> dict[str, Any]:
    """Return keys of campaign.json that do not come from the outcomes."""
    bench = campaign.file.bench_path
    return {
        "name": campaign.file.name,
        "bench": None if bench is None else str(bench),
        "program": program_digest(),
        "points": len(campaign.plan),
        "flown": campaign.flown,
        "wall_s": time.monotonic() - campaign.began_s,
    }
