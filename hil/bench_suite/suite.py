"""The benchmarks by name, and what is done with the result of each: table, JSON, plot, verdict."""

from __future__ import annotations

import json as jsonlib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hil.bench_suite.result import BenchmarkResult, work_precision_plot
from hil.report.run_json import finite
from hil.signals.errors import RecordingError

# name -> (module with a function `measure(*, quick, say) -> BenchmarkResult` and, if its picture is another one than
# error against time, `plot(result, title, path)`; title of the plot)
BENCHMARKS: dict[str, tuple[str, str]] = {
    "dash": ("hil.bench_suite.dash", "Dashboard: what an open page costs the run, and its memory"),
    "dataset": ("hil.bench_suite.dataset", "Data sets: frames a second, and what the labels get wrong"),
    "detect": ("hil.bench_suite.detect", "Detector: precision lost against the time of a picture"),
    "lidar": ("hil.bench_suite.lidar", "LiDAR: range error against time of a sweep"),
    "lockstep": ("hil.bench_suite.lockstep", "Lockstep loop: flight error against wall time"),
    "link": ("hil.bench_suite.link", "Links: lateness, message errors and flight errors against time"),
    "physics": ("hil.bench_suite.physics", "Flight physics: error against wall time"),
    "radar": ("hil.bench_suite.radar", "Radar: error of a raw frame against time"),
    "raster": ("hil.bench_suite.raster", "Raster: time and error beside MuJoCo's renderer"),
    "skip": ("hil.bench_suite.skip", "Skipping: what each rule saves"),
    "slam": ("hil.bench_suite.slam", "SLAM: error of trajectory and map against the time of an update"),
    "stability": ("hil.bench_suite.stability", "Stability: where each method stays finite and within tolerance"),
}

Say = Callable[[str], None]


def run_benchmark(name: str, *, json: Path | None, quick: bool, console: Console) -> bool:
    """Run one benchmark and show what it found; True if every check is met. RecordingError: files cannot be written."""
    module, title = BENCHMARKS[name]
    code = import_module(module)
    measure: Callable[..., BenchmarkResult] = code.measure
    # A benchmark whose picture is not error against time draws its own.
    draw: Callable[[BenchmarkResult, str, Path], None] = getattr(code, "plot", work_precision_plot)
    with console.status(f"hil bench {name}") as status:
        result = measure(quick=quick, say=lambda text: status.update(f"hil bench {name}: {text}"))
    _show(result, console)
    if json is not None:
        try:
            json.parent.mkdir(parents=True, exist_ok=True)
            json.write_text(jsonlib.dumps(finite(result.as_json(name)), indent=2) + "\n")
        except OSError as error:
            raise RecordingError(f"{json}: cannot be written ({error.strerror or error})") from error
        plot = json.with_suffix(".png")
        draw(result, title, plot)
        console.print(f"written: {json}, {plot}")
    return all(check.ok for check in result.checks)


def _show(result: BenchmarkResult, console: Console) -> None:
    rows = Table("case", "method", "error", "unit", result.time_label, box=None, pad_edge=False)
    for row in result.rows:
        rows.add_row(row.case, row.method, f"{row.error:.3g}", row.error_unit, f"{row.time_s:.4g}")
    console.print(rows)
    checks = Table("check", "value", "", "limit", "unit", "", box=None, pad_edge=False)
    for check in result.checks:
        mark = "[green]ok[/]" if check.ok else "[bold red]NOT MET[/]"
        checks.add_row(check.name, f"{check.value:.4g}", check.sense, f"{check.limit:g}", check.unit, mark)
    console.print(checks)
    for name in result.left_out:
        console.print(f"left out by --quick: {name}")
