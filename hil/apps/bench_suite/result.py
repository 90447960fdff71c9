"""Result of a benchmark: rows of run time and error, the checks that they must meet, and their plot."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from signals.errors import file_errors

ShowStatus = Callable[[str], None]  # displays the text, the current step of a benchmark
_MAX_PANELS = 30


@dataclass(frozen=True)
class Row:
    """Error and wall time of one method on one case.

    `method` may be "METHOD @ SETTING": the plot joins the settings of a method with a line.
    """

    case: str
    method: str
    error: float
    error_unit: str
    time_s: float
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Check:
    """A value and its limit. NaN meets no limit.

    `measures`: "speed" if other load on the machine moves the value (a time, a rate, a flight in real time); "error" if
    only the program and its inputs do.
    """

    name: str
    value: float
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    measures: Literal["error", "speed"] = "error"

    @property
    def ok(self) -> bool:
        """True if the value meets the limit."""
        return bool(self.value <= self.limit if self.sense == "<=" else self.value >= self.limit)


@dataclass(frozen=True)
class TextTable:
    """Table that is printed in place of the rows of a benchmark with more figures than error and time."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""


@dataclass
class BenchmarkResult:
    """Rows and checks of one benchmark. `left_out`: parts that were not run. `time_label`: label of the time axis."""

    rows: list[Row] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    time_label: str = "wall time [s]"
    tables: list[TextTable] = field(default_factory=list)

    @property
    def met(self) -> bool:
        """True if every check is met; a result without checks has shown nothing."""
        return bool(self.checks) and all(check.ok for check in self.checks)

    def keep_errors(self) -> None:
        """Remove the checks of speed."""
        self.checks = [check for check in self.checks if check.measures == "error"]
        self.left_out.append("checks of speed")

    def as_json(self, name: str) -> dict[str, Any]:
        """Return the JSON object of `hil bench --json`, whose keys are part of the command-line contract."""
        return {
            "bench": name,
            "machine": machine(),
            "rows": [{k: v for k, v in vars(row).items() if k != "details"} | row.details for row in self.rows],
            "checks": [{**vars(check), "ok": check.ok} for check in self.checks],
            "left_out": self.left_out,
        }


def machine() -> dict[str, Any]:
    """Return the processor, system and versions of this machine."""
    model = platform.processor()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    except OSError:
        pass  # not Linux: keep platform.processor()
    return {
        "cpu": model,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "architecture": platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def work_precision_plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Plot error against run time, one panel per case, both axes logarithmic.

    With many cases, or if no method has an error, plot one bar of run time per row. Raises RecordingError if the file
    cannot be written.
    """
    from matplotlib.figure import Figure  # slow to import, and only needed here

    rows = [row for row in result.rows if math.isfinite(row.time_s)]
    cases = list(dict.fromkeys(row.case for row in rows))
    if len(cases) > _MAX_PANELS or not any(row.error > 0 for row in rows):
        figure = Figure(figsize=(11.0, 1.2 + 0.25 * len(rows)), layout="constrained")
        ax = figure.subplots()
        bars = ax.barh([f"{row.case}: {row.method}" for row in rows], [row.time_s for row in rows])
        ax.bar_label(bars, [f"{row.time_s:.3g}, {row.error:.2g} {row.error_unit}" for row in rows], fontsize=8)
        ax.invert_yaxis()
        ax.margins(x=0.3)
        ax.set(xscale="log", xlabel=f"{result.time_label}; at each bar: time, error")
    else:
        columns = min(3, max(1, len(cases)))
        panel_rows = max(1, -(-len(cases) // columns))
        figure = Figure(figsize=(4.6 * columns, 3.6 * panel_rows), layout="constrained")
        axes = figure.subplots(panel_rows, columns, squeeze=False)
        for ax in list(axes.flat)[len(cases) :]:
            ax.set_visible(False)
        for ax, case in zip(axes.flat, cases, strict=False):
            _draw_case(ax, [row for row in rows if row.case == case], result.time_label)
    figure.suptitle(title)
    save_figure(figure, path)


def _draw_case(ax: Any, rows: Sequence[Row], time_label: str) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    floor = min((row.error for row in rows if row.error > 0), default=1e-15) / 10
    for method in dict.fromkeys(row.method.split(" @ ")[0] for row in rows):
        method_rows = [row for row in rows if row.method.split(" @ ")[0] == method]
        errors = [row.error if row.error > 0 else floor for row in method_rows]
        ax.plot(
            [row.time_s for row in method_rows],
            errors,
            "o-" if len(method_rows) > 1 else "o",
            label=method,
            markersize=5,
        )
    ax.set(xscale="log", yscale="log", xlabel=time_label, ylabel=f"error [{rows[0].error_unit}]")
    times_s = [row.time_s for row in rows]
    span = max(times_s) / min(times_s)
    subs = (1.0, 2.0, 5.0) if span < 50.0 else (1.0,)
    ax.xaxis.set_major_locator(LogLocator(subs=subs) if span > 2.0 else MaxNLocator(3))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_title(rows[0].case, loc="left", fontsize=10, fontweight="bold")
    ax.grid(True, which="both", color="#e6e9ed", linewidth=0.7)
    ax.legend(fontsize=8, frameon=False)


def save_figure(figure: Any, path: Path) -> None:
    """Write a matplotlib figure to a picture file. Raises RecordingError if that fails."""
    with file_errors(path, "the plot cannot be written"):
        figure.savefig(path, dpi=130)
