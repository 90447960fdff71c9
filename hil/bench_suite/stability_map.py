"""The picture of the stability sweeps: one panel a sweep, a line a method, a field a setting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hil.bench_suite.result import Row
from hil.signals.errors import RecordingError

WITHIN, OUT, LOST, NAMED = "within tolerance", "finite, out of tolerance", "not finite", "ended with a named error"
_COLOURS = {WITHIN: "#4c9f70", OUT: "#f0c24b", LOST: "#c8453b", NAMED: "#6f7fb5"}
_NOT_FINITE = 1e299


def draw_map(rows: Sequence[Row], title: str, path: Path) -> None:
    """RecordingError if the file cannot be written. Numbers in the fields are errors over their tolerance."""
    from matplotlib.figure import Figure  # slow to import, and only needed here
    from matplotlib.patches import Patch

    sweeps = list(dict.fromkeys(row.details["sweep"] for row in rows))
    columns = 2
    lines = -(-len(sweeps) // columns)
    figure = Figure(figsize=(15.0, 1.75 * lines + 0.8), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False)
    for ax in list(axes.flat)[len(sweeps) :]:
        ax.set_visible(False)
    for ax, sweep in zip(axes.flat, sweeps, strict=False):
        mine = [row for row in rows if row.details["sweep"] == sweep]
        methods = list(dict.fromkeys(row.method for row in mine))
        values = list(dict.fromkeys(row.details["value"] for row in mine))
        for row in mine:
            at_x, at_y = values.index(row.details["value"]), methods.index(row.method)
            field = _COLOURS[row.details["verdict"]]
            ax.add_patch(_square(at_x, at_y, field))
            ax.text(at_x, at_y, _said(row), ha="center", va="center", fontsize=7.5)
        ax.set_xlim(-0.5, len(values) - 0.5)
        ax.set_ylim(len(methods) - 0.5, -0.5)
        ax.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=8)
        ax.set_yticks(range(len(methods)), methods, fontsize=8)
        ax.tick_params(length=0)
        limit = mine[0].details["tolerance"]
        allowed = f"{limit:g} {mine[0].error_unit}" if limit else f"no gain in {mine[0].error_unit}"
        ax.set_title(
            f"{sweep} [{mine[0].details['unit']}], tolerance {allowed}", loc="left", fontsize=9, fontweight="bold"
        )
    handles = [Patch(facecolor=colour, label=label) for label, colour in _COLOURS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.suptitle(f"{title}\nfields: error", fontsize=11)
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise RecordingError(f"{path}: the map cannot be written ({error.strerror or error})") from error


def _square(x: int, y: int, colour: str):  # type: ignore[no-untyped-def]  # matplotlib is imported late
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=colour, edgecolor="none")


def _said(row: Row) -> str:
    if row.error > _NOT_FINITE:
        return "named" if row.details["verdict"] == NAMED else "not finite"
    return f"{row.error:.1e}" if row.error else "0"
