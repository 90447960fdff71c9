"""What a benchmark yields: rows of run time against error, and the checks that its figures must meet."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hil.signals.errors import RecordingError


@dataclass(frozen=True)
class Row:
    """One method on one case: its error, and the wall time it took. No time without its error, and the reverse."""

    case: str
    method: str
    error: float
    error_unit: str
    time_s: float
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Check:
    """One figure held against its limit. NaN never meets one."""

    name: str
    value: float
    sense: Literal["<=", ">="]
    limit: float
    unit: str

    @property
    def ok(self) -> bool:
        return bool(self.value <= self.limit if self.sense == "<=" else self.value >= self.limit)


@dataclass
class BenchmarkResult:
    """Everything one benchmark found. `left_out` names the checks that `--quick` skips."""

    rows: list[Row] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    time_label: str = "wall time [s]"
    panels: list[Callable[[Any], None]] = field(default_factory=list)  # each draws on one more matplotlib Axes

    def as_json(self, name: str) -> dict[str, Any]:
        """The JSON form fixed by the command-line contract."""
        return {
            "bench": name,
            "machine": machine(),
            "rows": [{k: v for k, v in vars(row).items() if k != "details"} | row.details for row in self.rows],
            "checks": [{**vars(check), "ok": check.ok} for check in self.checks],
            "left_out": self.left_out,
        }


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    model = platform.processor()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    except OSError:
        pass  # not Linux: platform.processor() has to do
    return {
        "cpu": model,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "architecture": platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def work_precision_plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Error against run time, one panel per case, both axes logarithmic. RecordingError if it cannot be written."""
    from matplotlib.figure import Figure  # slow to import, and only needed here
    from matplotlib.ticker import LogLocator, NullFormatter

    cases = list(dict.fromkeys(row.case for row in result.rows))
    count = len(cases) + len(result.panels)
    columns = min(3, max(1, count))
    lines = -(-count // columns)
    figure = Figure(figsize=(4.6 * columns, 3.6 * lines), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False)
    for ax, draw in zip(list(axes.flat)[len(cases) :], result.panels, strict=False):
        draw(ax)
    for ax in list(axes.flat)[count:]:
        ax.set_visible(False)
    for ax, case in zip(axes.flat, cases, strict=False):
        rows = [row for row in result.rows if row.case == case]
        floor = _smallest_positive([row.error for row in rows]) / 10
        for method in dict.fromkeys(row.method.split(" @ ")[0] for row in rows):
            mine = [row for row in rows if row.method.split(" @ ")[0] == method]
            times = [row.time_s for row in mine]
            errors = [row.error if row.error > 0 else floor for row in mine]
            ax.plot(times, errors, "o-" if len(mine) > 1 else "o", label=method, markersize=5)
        ax.set_xscale("log")
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_yscale("log")
        ax.set_xlabel(result.time_label)
        ax.set_ylabel(f"error [{rows[0].error_unit}]")
        ax.set_title(case, loc="left", fontsize=10, fontweight="bold")
        ax.grid(True, which="both", color="#e6e9ed", linewidth=0.7)
        ax.legend(fontsize=8, frameon=False)
    figure.suptitle(title)
    save_figure(figure, path)


def _smallest_positive(values: Sequence[float]) -> float:
    return min((v for v in values if v > 0), default=1e-15)


def save_figure(figure: Any, path: Path) -> None:
    """A matplotlib figure to a picture. RecordingError if it cannot be written."""
    try:
        figure.savefig(path, dpi=130)
    except OSError as error:
        raise RecordingError(f"{path}: the plot cannot be written ({error.strerror or error})") from error
