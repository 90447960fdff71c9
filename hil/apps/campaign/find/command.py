"""`hil campaign shrink` and `hil campaign search`."""

from __future__ import annotations

import shlex
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from hil.apps.campaign.campaign import Progress
from hil.apps.campaign.cases.campaign_file import CampaignFile, load_campaign
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.command import CampaignProgress, campaign_problems
from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.find.magnitudes import TOLERANCE
from hil.apps.campaign.find.search import Search, objective
from hil.apps.campaign.find.shrink import Shrinking, Shrunk, way_of_failing
from hil.apps.campaign.find.trials import Trials
from hil.apps.campaign.flight import Outcome
from hil.apps.campaign.results import tables
from hil.apps.campaign.results.again import run_command
from hil.apps.campaign.results.answers import LiveSummary, check_name
from hil.apps.campaign.store import STORE_NAME, Store
from hil.run.report.run_folder import run_folder
from hil.run.report.run_json import write_run_json
from hil.run_files import SUMMARY_NAME
from signals.documents.document import shown_path
from signals.errors import ConfigError, file_errors
from signals.processors import usable_processors
from signals.words import counted

CAMPAIGNS = Path("campaigns")
SHRUNK = "shrunk"  # folder of a campaign


@dataclass(frozen=True)
class ShrinkOptions:
    """Options of `hil campaign shrink`."""

    out: Path | None = None  # of the campaign; None: any in ./campaigns that has the case
    workers: int | None = None
    tolerance: float = TOLERANCE
    quiet: bool = False


@dataclass(frozen=True)
class SearchOptions:
    """Options of `hil campaign search`."""

    trials: int = 200
    sampler: str = "tpe"
    batch: int = 8
    seed: int | None = None  # of the sampler; None: sampling_seed of the file
    every: bool = False  # go on after the first failure
    out: Path | None = None
    resume: bool = False
    workers: int | None = None
    quiet: bool = False


def shrink_case(prefix: str, options: ShrinkOptions, console: Console) -> Shrunk:
    """Make a failing case smaller, write shrunk/CASE.json in its campaign, and print the result. Raises HilError."""
    folder = options.out or _folder_of(prefix)
    _require_campaign(folder)
    with run_folder(folder), Store(folder) as store:
        case, outcome, texts = _failing_case(store, prefix, folder)
        base = store.base()
        if base is None:
            text = f"{shown_path(folder)} does not tell its base bench: it was made by an earlier version"
            raise ConfigError.at("CASE", text, "`hil campaign FILE --resume` adds it")
        with closing(LocalEngine(options.workers or usable_processors())) as engine:
            trials = Trials(store, engine, base[0], folder)
            shrinking = Shrinking(trials, texts, outcome, base[1], folder / SHRUNK)
            if not options.quiet:
                console.print(f"{case}: {outcome.reasons[0]}")
                shrinking.say = console.print
            try:
                found = shrinking.run(case, options.tolerance)
            finally:
                trials.end()
        path = folder / SHRUNK / f"{case}.json"
        _write(path, case, outcome, found, base[0], trials)
    _print_shrunk(found, base[0], trials, path, console)
    return found


def search_failures(path: Path, options: SearchOptions, console: Console) -> int:
    """Look for failures of a campaign's bench. Returns `Search.exit_status`; raises HilError."""
    file = load_campaign(path)
    plan = Plan(file)
    if problems := campaign_problems(plan, file):
        raise ConfigError(problems)
    seed = file.spec.sampling_seed if options.seed is None else options.seed
    search = Search(file, plan, options.sampler, seed % 2**32)
    out = options.out or CAMPAIGNS / f"{file.name}-search"
    if (out / STORE_NAME).is_file() and not options.resume:
        hint = "repeat the search with --resume, which flies no stored case again, or name another folder with --out"
        raise ConfigError.at(str(out), "holds a campaign or a search", hint)
    check_name(out, _search_name(file))
    workers, began_s = options.workers or max(1, usable_processors() // file.spec.cores), time.monotonic()
    engine = LocalEngine(workers, cores=file.spec.cores, timeout_s=file.spec.flight_timeout_s)
    with run_folder(out), Store(out) as store, closing(engine):
        trials = Trials(store, engine, file.bench_path, out)
        with CampaignProgress(f"search {file.name}", options.trials, quiet=options.quiet) as progress:
            live = LiveSummary(out, progress.update, lambda: _facts(file, options, search, time.monotonic() - began_s))
            search.show = trials.show = lambda: live(Progress("trials", search.tried, options.trials, search.tally))
            try:
                search.run(trials, store, count=options.trials, batch=options.batch, every=options.every)
            finally:
                trials.end()
                _write_tables(out, store, plan, search, _facts(file, options, search, time.monotonic() - began_s))
    _print_search(file.name, out, search, console)
    return search.exit_status


def _folder_of(prefix: str) -> Path:
    """Return the folder of the campaigns here that has a case. Raises ConfigError unless there is exactly one."""
    found = []
    for path in sorted(CAMPAIGNS.glob(f"*/{STORE_NAME}")):
        with Store(path.parent) as store:
            if store.flown(prefix):
                found.append(path.parent)
    if len(found) == 1:
        return found[0]
    if found:
        text = f"{prefix} is a case of {len(found)} campaigns: {', '.join(map(str, found))}"
    else:
        text = f"no campaign in {CAMPAIGNS}/ has a case that begins with {prefix!r}"
    raise ConfigError.at("CASE", text, "name the folder of the campaign with --out")


def _require_campaign(folder: Path) -> None:
    if not (folder / STORE_NAME).is_file():
        raise ConfigError.at("--out", f"{shown_path(folder)} holds no campaign: there is no {STORE_NAME}")


def _failing_case(store: Store, prefix: str, folder: Path) -> tuple[str, Outcome, tuple[str, ...]]:
    found = store.flown(prefix)
    if len(found) != 1:
        names = ", ".join(case for case, *_ in found[:4]) + (", ..." if len(found) > 4 else "")
        text = f"begins {len(found)} cases: {names}" if found else "is not a case"
        hint = "give more digits" if found else "results.csv has the cases in its first column"
        raise ConfigError.at("CASE", f"{prefix!r} {text} of {shown_path(folder)}", hint)
    case, outcome, texts = found[0]
    if outcome.status == "ERROR":
        text = f"{case} is an ERROR, which says nothing about the vehicle: {outcome.error_type}: {outcome.error}"
        raise ConfigError.at("CASE", text, "only a FAIL can be made smaller")
    if outcome.status == "FAIL" and objective(outcome) is None:
        text = f"{case} says nothing about the vehicle: {outcome.reasons[0]}"
        raise ConfigError.at("CASE", text, "only a FAIL of the vehicle can be made smaller")
    if not way_of_failing(outcome):
        raise ConfigError.at("CASE", f"{case} is a PASS: there is no failure to make smaller")
    difference = store.difference(case)
    if difference:
        text = f"{case} is a FLAKE, it does not repeat: {difference}"
        raise ConfigError.at("CASE", text, "find what differs first: docs/determinism.md")
    return case, outcome, texts


def _write(path: Path, case: str, outcome: Outcome, found: Shrunk, bench: Path | None, trials: Trials) -> None:
    """Write the result of shrinking. Raises RecordingError."""
    data = {
        "schema": 1,
        "case": case,
        "reason": outcome.reasons[0],
        "smallest": found.case,
        "smallest_reason": found.outcome.reasons[0] if found.outcome.reasons else None,
        "removed": found.removed,
        "reduced": found.reduced,
        "remains": found.remains,
        "notes": found.notes,
        "trials": len(trials.asked),
        "bench": None if bench is None else str(bench),
        "set": list(found.texts),
        "command": _command(bench, found),
    }
    with file_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_run_json(path, data)


def _command(bench: Path | None, found: Shrunk) -> str:
    return run_command(None if bench is None else Path(shown_path(bench)), found.texts)


def _print_shrunk(found: Shrunk, bench: Path | None, trials: Trials, path: Path, console: Console) -> None:
    for title, lines in (("removed", found.removed), ("reduced", found.reduced), ("remains", found.remains)):
        console.print(f"{title}: {'' if lines else 'nothing'}")
        for line in lines:
            console.print(f"  {line}")
    for note in found.notes:
        console.print(f"note: {note}")
    console.print(
        f"smallest failure: {found.outcome.reasons[0]} ({counted(len(trials.asked), 'trial')}, {trials.flown} flown)"
    )
    console.print(_command(bench, found))
    console.print(f"{shown_path(path)}")


def _search_name(file: CampaignFile) -> str:
    return f"{file.name}-search"


def _facts(file: CampaignFile, options: SearchOptions, search: Search, wall_s: float) -> dict[str, Any]:
    first = None if search.first is None else {"trial": search.first[0] + 1, "case": search.first[1].case}
    told = {"trials": search.tried, "first_failure": first}
    return {"name": _search_name(file), "points": options.trials, "search": told, "wall_s": wall_s}


def _write_tables(out: Path, store: Store, plan: Plan, search: Search, facts: dict[str, Any]) -> None:
    names = sorted({limit.name for case in store.cases() for limit in case.outcome.limits})
    rows, lines = tables.csv_rows(out / tables.CSV_NAME, plan.axes, names), tables.json_lines(out / tables.LINES_NAME)
    tables.write_each(store.cases(), rows, lines)
    ended = {"exit_status": search.exit_status, "complete": search.ended, "doing": None, "stopped": None}
    tables.write_summary(out / SUMMARY_NAME, search.tally, {**facts, **ended})


def _print_search(name: str, out: Path, search: Search, console: Console) -> None:
    tally = search.tally
    counts = f"{tally.passed} PASS, {tally.failed} FAIL, {tally.errors} ERROR"
    console.print(f"{name}: {counted(search.tried, 'trial')}, {counted(tally.cases, 'case')}: {counts}")
    smallest = search.smallest
    worst = None if smallest is None else smallest.outcome.worst
    if smallest is not None and worst is not None and worst.margin is not None:
        console.print(f"smallest margin {worst.margin:.3f} ({worst.name}) in case {smallest.case}")
    if search.unmet:
        text = f"warning: {counted(len(search.unmet), 'trial')} without what was declared, such as"
        console.print(f"{text} {search.unmet[0]}", markup=False)
    if search.first is None:
        console.print("no trial says anything about the vehicle" if smallest is None else "no failure found")
        return
    number, trial = search.first
    console.print(f"first failure in trial {number + 1}, case {trial.case}: {trial.outcome.reasons[0]}")
    console.print(f"make it smaller: {shlex.join(['hil', 'campaign', 'shrink', trial.case, '--out', str(out)])}")
