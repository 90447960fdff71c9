"""`hil campaign`: check the file, fly the campaign, write its tables."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from hil.apps.campaign.campaign import Campaign, Progress
from hil.apps.campaign.cases.campaign_file import CampaignFile, load_campaign
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.engines.engine import Engine
from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.results.answers import LiveSummary, check_name, facts_of, write_results
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.results.summary import Summary
from hil.apps.campaign.stop_rule import parse_stop
from hil.apps.campaign.store import STORE_NAME, Store
from hil.cluster.join import uses_ray
from hil.cluster.waiting import said_on
from hil.config import load_bench
from hil.config.vehicles.checks import is_flown
from hil.run.report.run_folder import run_folder
from hil.run.runs.progress import CountProgress, minutes
from hil.run_files import PAGE_NAME
from signals.errors import ConfigError, Problem
from signals.processors import usable_processors
from signals.words import counted

_LONG_S = 2 * 86_400.0
MANY = 100_000  # points that need --yes
MOST_PROBLEMS = 50  # that are shown


@dataclass(frozen=True)
class CampaignOptions:
    """Options of `hil campaign`."""

    engine: str = "local"
    address: str | None = None  # of a Ray cluster
    workers: int | None = None  # None: one for each processor
    out: Path | None = None
    resume: bool = False
    stop_after: tuple[str, ...] = ()
    dry_run: bool = False
    yes: bool = False
    quiet: bool = False


class CampaignProgress(CountProgress):
    """Display of flights done, their outcomes, and the time left."""

    def __init__(self, name: str, total: int, *, quiet: bool) -> None:
        super().__init__(name, total, quiet=quiet)
        self._state = Progress("flights", 0, total, Tally())
        self._began: tuple[float, int, str] | None = None

    def update(self, state: Progress) -> None:
        """Show a new state."""
        self._state, self._total = state, state.total
        self.show(state.done)

    def text(self, done: int, now_s: float) -> str:
        """Return counts and the time left."""
        tally, phase = self._state.tally, self._state.phase
        if self._began is None or self._began[2] != phase:
            self._began = now_s, done, phase
        counts = f"{tally.passed} PASS, {tally.failed} FAIL, {tally.errors} ERROR"
        made, took_s = done - self._began[1], now_s - self._began[0]
        left = f", {minutes((self._total - done) * took_s / made)} left" if made > 0 else ""
        return f"{phase}: {done} of {self._total}; {counts}{left}"


def run_campaign(path: Path, options: CampaignOptions, console: Console) -> int:
    """Fly the campaign of a file and return its exit status: 0 all PASS, 1 FAIL or FLAKE, 3 ERROR. Raises HilError."""
    file = load_campaign(path)
    plan = Plan(file)
    stop = parse_stop(options.stop_after, file.spec.stop)
    problems = campaign_problems(plan, file)
    if problems:
        raise ConfigError(problems)
    workers = options.workers or max(1, usable_processors() // file.spec.cores)
    if options.dry_run:
        return 3 if print_plan(file, plan, workers, console) == "ERROR" else 0
    if len(plan) > MANY and not options.yes:
        text = f"has {len(plan):,} points; --dry-run estimates their time, --yes flies them"
        raise ConfigError.at(file.document.source, text)
    out = options.out or Path("campaigns") / file.name
    if (out / STORE_NAME).is_file() and not options.resume:
        hint = "continue it with --resume, or name another folder with --out"
        raise ConfigError.at(str(out), "holds a campaign", hint)
    check_name(out, file.name)
    with closing(make_engine(options, file, workers, console)) as engine, run_folder(out), Store(out) as store:
        with CampaignProgress(file.name, len(plan), quiet=options.quiet) as progress:
            campaign = Campaign(file, plan, store, engine, out, stop)
            campaign.show = LiveSummary(out, progress.update, lambda: facts_of(campaign))
            try:
                campaign.run()
            finally:
                summary = write_results(campaign)
        _print_result(campaign, summary, console)
    return summary.tally.exit_status


def make_engine(options: CampaignOptions, file: CampaignFile, workers: int, console: Console) -> Engine:
    """Return the engine that the options name. Raises HilError if it cannot be used."""
    if uses_ray(options.engine, options.address):
        from hil.apps.campaign.engines.ray import RayEngine

        return RayEngine(
            file.spec,
            address=options.address,
            workers=options.workers,
            processors=usable_processors(),
            say=said_on(console, quiet=options.quiet),
        )
    return LocalEngine(workers, cores=file.spec.cores, timeout_s=file.spec.flight_timeout_s)


def campaign_problems(plan: Plan, file: CampaignFile) -> list[Problem]:
    """Return the problems of a campaign that can be found without a flight: its bench with every value of an axis.

    Raises ConfigError if there is no such bench.
    """
    path = file.bench_path
    if file.spec.skip and len(plan) <= MANY and next(iter(plan), None) is None:
        return [file.problem(("skip",), "leaves no point of the plan")]
    problems: dict[tuple[str, str], Problem] = {}  # by what the bench says, so that each is told once
    flown = False
    for axis, point in plan.trials():
        try:
            bench = load_bench(path, settings=point.texts)
            flown |= any(is_flown(vehicle) for vehicle in bench.each_vehicle.values())
            if bench.config.foxglove.port is not None and bench.config.foxglove.paused:
                text = "is true: each flight would wait for a client"
                raise ConfigError.at("foxglove.paused", text, "set it to false")
        except ConfigError as error:
            for problem in error.problems:
                known = (problem.where, problem.message)
                if known not in problems:
                    named = axis or _axis_of(problem.where, plan.axes)
                    section = "axes" if named in file.spec.axes else "sampled"
                    where = file.problem((section, named) if named else ("settings",), "").where
                    text = f"{axis} = {point.values[axis]!r}: " if axis else ""
                    problems[known] = Problem(where, f"{text}{problem.where}: {problem.message}", problem.hint)
    if not problems and not flown:
        hint = "settings: {mission: FILE}, a companion with control: true, or router"
        return [Problem(file.document.source, "flies nothing: nobody flies the vehicle of its bench", hint)]
    shown, more = list(problems.values())[:MOST_PROBLEMS], len(problems) - MOST_PROBLEMS
    return shown if more <= 0 else [*shown, Problem(file.document.source, f"has {more} more problems")]


def _axis_of(where: str, axes: Sequence[str]) -> str:
    """Return the axis that a problem of a bench is about, empty if it is about none."""
    key = where.removeprefix("--set ")
    return next((axis for axis in axes if f"{key}.".startswith(f"{axis}.") or f"{axis}.".startswith(f"{key}.")), "")


def check_campaign(path: Path) -> str:
    """Check the file of a campaign without a flight and return a line about it. Raises ConfigError."""
    file = load_campaign(path)
    plan = Plan(file)
    problems = campaign_problems(plan, file)
    if problems:
        raise ConfigError(problems)
    return f"ok: campaign of {counted(len(plan), 'point')}, axes {', '.join(plan.axes) or 'none'}"


def print_plan(file: CampaignFile, plan: Plan, workers: int, console: Console) -> str:
    """Print how many cases a campaign has and how long they take, estimated from one flight; return its status."""
    import tempfile

    from hil.apps.campaign.flight import Job, fly

    texts = plan.at(plan.first_values()).texts
    with tempfile.TemporaryDirectory() as folder:
        bench = file.bench_path
        job = Job("trial", None if bench is None else str(bench), texts, f"{folder}/run")
        fly(job)  # the first flight of a process loads the map
        outcome = fly(job)
    total_s = outcome.wall_s * max(1.0, len(plan) * (1.0 + file.spec.recheck) / workers)
    skipped = " before skip" if file.spec.skip else ""
    console.print(f"{file.name}: {counted(len(plan), 'point')}{skipped}, axes {', '.join(plan.axes) or 'none'}")
    console.print(f"one flight: {outcome.status}, {outcome.sim_s:.1f} s simulated, {outcome.wall_s:.2f} s wall clock")
    duration = minutes(total_s) if total_s < _LONG_S else f"{total_s / 86_400:,.0f} days"
    console.print(f"estimate: {duration} with {counted(workers, 'worker')}")
    for line in (outcome.error, *outcome.reasons):
        if line:
            console.print(f"  {line}")
    return outcome.status


def _print_result(campaign: Campaign, summary: Summary, console: Console) -> None:
    tally = summary.tally
    low, rate, high = tally.interval()
    counts = f"{tally.passed} PASS, {tally.failed} FAIL, {tally.errors} ERROR, {tally.flakes} FLAKE"
    console.print(f"{campaign.file.name}: {counted(tally.cases, 'case')}: {counts}")
    if tally.judged:
        console.print(f"pass rate {rate:.3f}, between {low:.3f} and {high:.3f} (95 %)")
    if campaign.stopped:
        console.print(f"stopped early: {campaign.stopped}")
    if campaign.not_compared:
        console.print(
            f"warning: {counted(campaign.not_compared, 'second flight')} could not be made; --resume flies the rest"
        )
    if summary.unmet:
        text = f"warning: {counted(summary.unmet, 'case')} without what was declared, such as"
        console.print(f"{text} {summary.unmet_example}", markup=False)
    console.print(f"{campaign.out / PAGE_NAME}")
