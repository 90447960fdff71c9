"""`hil bench`: runs of benchmarks by name, and the output of their results as table, JSON and plot.

A benchmark is one file, here or in `lab/`, with `TITLE`, that of its plot, and a function
`measure(*, quick, status) -> BenchmarkResult`, which takes `options` too if `hil bench --set` applies to it, and
`errors_only` if it then has less to do. It may have `missing() -> str`, the reason why this machine cannot run it
("" if it can), which leaves it out of ALL, and `plot(result, title, path)`, which replaces the plot of error against
time and returns the paths of further files.
"""

from __future__ import annotations

import json as jsonlib
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hil.apps.bench_suite.cases import NEEDS_CHECKOUT, benchmarks, has_lab, import_case
from hil.apps.bench_suite.options import split_settings
from hil.apps.bench_suite.result import BenchmarkResult, work_precision_plot
from hil.run.report.run_json import finite
from signals.documents.validate import nearest
from signals.errors import ConfigError, Problem, file_errors

ALL = "all"
_INSTALLED = " of this installation; a further one needs a checkout of hil-bench: `make setup` there"


def run_benchmarks(
    name: str,
    *,
    json: Path | None,
    quick: bool,
    console: Console,
    settings: Sequence[str] = (),
    errors_only: bool = False,
    without: Sequence[str] = (),
) -> bool:
    """Run one benchmark or ALL that this machine can run, print the results and return True if all checks are met.

    With `json`, write the result to that file and its plot to a .png with the same name. `settings`: KEY=VALUE texts.
    `errors_only` leaves out the checks of speed, which other load on the machine moves; `without` names benchmarks that
    ALL leaves out.

    Raises ConfigError for a name that is no benchmark of this machine, or an unknown setting; RecordingError if a file
    cannot be written.
    """
    unknown = [each for each in (*without, *([] if name == ALL else [name])) if each not in benchmarks()]
    if unknown:
        where, known = "" if has_lab() else _INSTALLED, (*benchmarks(), ALL)
        raise ConfigError(
            [Problem("hil bench", f"no benchmark {each!r}{where}", nearest(each, known)) for each in unknown]
        )
    if name == ALL:
        if json is not None or settings:
            raise ConfigError.at("hil bench all", "takes neither --json nor --set", "name one benchmark")
        results: dict[str, BenchmarkResult] = {}
        for each, module in benchmarks().items():
            console.rule(f"hil bench {each}", align="left")
            if reason := "--without" if each in without else _missing(module):
                console.print(f"left out: {reason}")
            else:
                results[each] = _run(
                    each, json=None, quick=quick, console=console, settings=(), errors_only=errors_only
                )
        if not has_lab():
            console.print(f"left out: lab/, which {NEEDS_CHECKOUT}")
        _print_summary(results, console)
        return bool(results) and all(result.met for result in results.values())
    if without:
        raise ConfigError.at("--without", "applies to 'hil bench all' alone")
    return _run(name, json=json, quick=quick, console=console, settings=settings, errors_only=errors_only).met


def _missing(module: str) -> str:
    """Return the reason why this machine cannot run a benchmark, or ""."""
    missing: Callable[[], str] = getattr(import_case(module), "missing", str)
    return missing()


def _run(
    name: str, *, json: Path | None, quick: bool, console: Console, settings: Sequence[str], errors_only: bool
) -> BenchmarkResult:
    benchmark = import_case(benchmarks()[name])
    measure: Callable[..., BenchmarkResult] = benchmark.measure
    draw: Callable[[BenchmarkResult, str, Path], list[Path] | None] = getattr(benchmark, "plot", work_precision_plot)
    takes = signature(measure).parameters
    options: dict[str, Any] = {"options": split_settings(settings)} if settings else {}
    if options and "options" not in takes:
        raise ConfigError.at("--set", f"does not apply to the benchmark {name!r}")
    if errors_only and "errors_only" in takes:
        options["errors_only"] = True
    if json is not None:
        _check_writable(json)
    with console.status(f"hil bench {name}") as line:
        result = measure(quick=quick, status=lambda text: line.update(f"hil bench {name}: {text}"), **options)
    if errors_only:
        result.keep_errors()
    _print(result, console)
    if json is not None:
        with file_errors(json):
            json.write_text(jsonlib.dumps(finite(result.as_json(name)), indent=2) + "\n")
        plot = json.with_suffix(".png")
        further = draw(result, benchmark.TITLE, plot) or []
        console.print(f"written: {', '.join(str(path) for path in (json, plot, *further))}")
    return result


def _check_writable(file: Path) -> None:
    """Make the folder of a result, and see that the file can be written: known before hours of measuring.

    Raises RecordingError.
    """
    with file_errors(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        existed = file.exists()
        with file.open("a"):
            pass
        if not existed:
            file.unlink()


def _print_summary(results: dict[str, BenchmarkResult], console: Console) -> None:
    """Print what was not met, last: nobody finds it among the tables of twenty benchmarks."""
    console.rule("hil bench all", align="left")
    console.print(f"{sum(result.met for result in results.values())} of {len(results)} benchmarks met every check")
    for name, result in results.items():
        for check in result.checks:
            if not check.ok:
                line = f"{name}: {check.name}: {check.value:.4g}, not {check.sense} {check.limit:g} {check.unit}"
                console.print(Text("NOT MET ", "bold red") + line.rstrip(), soft_wrap=True)
        if not result.checks:
            console.print(Text("NOT MET ", "bold red") + f"{name}: no check was made", soft_wrap=True)


def _print(result: BenchmarkResult, console: Console) -> None:
    for table in result.tables:
        shown = Table(*table.header, box=None, pad_edge=False)
        for cells in table.rows:
            shown.add_row(*cells)
        console.print(shown)
        console.print(table.note)
    rows = Table("case", "method", "error", "unit", result.time_label, box=None, pad_edge=False)
    for row in result.rows:
        rows.add_row(row.case, row.method, f"{row.error:.3g}", row.error_unit, f"{row.time_s:.4g}")
    if not result.tables:
        console.print(rows)
    checks = Table("check", "value", "", "limit", "unit", "", box=None, pad_edge=False)
    for check in result.checks:
        mark = Text("ok", "green") if check.ok else Text("NOT MET", "bold red")
        checks.add_row(check.name, f"{check.value:.4g}", check.sense, f"{check.limit:g}", check.unit, mark)
    console.print(checks)
    for name in result.left_out:
        console.print(f"left out: {name}")
