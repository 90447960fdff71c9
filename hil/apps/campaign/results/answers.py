"""Files of a campaign: its tables, JUnit and page at the end, and campaign.json while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from hil.apps.campaign.campaign import Campaign, Progress
from hil.apps.campaign.identity import program_digest
from hil.apps.campaign.results import tables
from hil.apps.campaign.results.groups import groups_of
from hil.apps.campaign.results.junit import JUNIT_NAME, write_junit
from hil.apps.campaign.results.page import Facts, write_page
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.results.summary import Summary

_LIVE_PERIOD_S = 2.0  # between two campaign.json of a campaign that goes on


class LiveSummary:
    """Writes campaign.json every few seconds while a campaign goes on, and calls `show` after every flight."""

    def __init__(self, campaign: Campaign, show: Callable[[Progress], None]) -> None:
        self._campaign, self._show = campaign, show
        self._next_s = 0.0

    def __call__(self, state: Progress) -> None:
        self._show(state)
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + _LIVE_PERIOD_S
            campaign, tally = self._campaign, state.tally
            doing = {"phase": state.phase, "done": state.done, "total": state.total}
            more = {**_state(campaign, tally, now_s - campaign.began_s), "complete": False, "doing": doing}
            tables.write_summary(campaign.out / tables.SUMMARY_NAME, tally, more)


def write_results(campaign: Campaign, wall_s: float) -> Tally:
    """Write all tables and the page of a campaign, complete or not, and return its counts. Raises RecordingError."""
    store, out, file = campaign.store, campaign.out, campaign.file
    summary = Summary.of(groups_of(file.spec), store.cases())
    tally, name, bench = summary.tally, file.name, file.bench_path
    complete = not campaign.stopped and not campaign.unfinished
    tables.write_csv(out / tables.CSV_NAME, store.cases(), campaign.plan.axes, sorted(summary.limits))
    tables.write_lines(out / tables.LINES_NAME, store.cases())
    write_junit(out / JUNIT_NAME, name, store.cases(), summary, bench)
    ended = {"complete": complete, "doing": None, "stopped": campaign.stopped or None}
    more = {**_state(campaign, tally, wall_s), **ended, **summary.data()}
    tables.write_summary(out / tables.SUMMARY_NAME, tally, more)
    points, flown, stopped = len(campaign.plan), campaign.flown, campaign.stopped
    facts = Facts(name, file.spec.description, out, bench, points, stopped, complete, flown, wall_s)
    write_page(facts, summary)
    return tally


def _state(campaign: Campaign, tally: Tally, wall_s: float) -> dict[str, Any]:
    bench = campaign.file.bench_path
    return {
        "name": campaign.file.name,
        "bench": None if bench is None else str(bench),
        "program": program_digest(),
        "points": len(campaign.plan),
        "flown": campaign.flown,
        "wall_s": wall_s,
        "exit_status": tally.exit_status,
    }
