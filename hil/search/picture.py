"""A map of a search: who was there, who was found, and what was found where nobody is. Slow to import."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from hil.config.schema import Search
from hil.search.judgement import SearchResult

_SEEN, _UNSEEN, _FOUND, _FALSE, _WAY = "#0072b2", "#9aa5b1", "#009e73", "#d55e00", "#c7ced6"


def search_figure(result: SearchResult, search: Search, flown_m: Sequence[tuple[float, float]]) -> Figure:
    """East to the right, north up [m]. A line leads from each found person to where it was said to be."""
    figure = Figure(figsize=(8.6, 7.6), layout="constrained")
    ax = figure.subplots()
    if flown_m:
        ax.plot([p[0] for p in flown_m], [p[1] for p in flown_m], "-", color=_WAY, lw=1.2, label="way flown")
    groups = (
        ("to be seen", _SEEN, [one for one in result.people if one.visible]),
        ("never or hardly to be seen", _UNSEEN, [one for one in result.people if not one.visible]),
    )
    for label, colour, people in groups:
        if people:
            xy = [one.truth_m for one in people]
            ax.plot([p[0] for p in xy], [p[1] for p in xy], "o", color=colour, ms=9, mfc="none", mew=1.6, label=label)
    found = [one for one in result.people if one.found_m is not None]
    for one in found:
        assert one.found_m is not None
        ax.plot([one.truth_m[0], one.found_m[0]], [one.truth_m[1], one.found_m[1]], "-", color=_FOUND, lw=1.0)
        ax.annotate(f"{one.error_m:.1f} m", one.found_m, (5, 5), textcoords="offset points", fontsize=7, color=_FOUND)
    if found:
        at = [one.found_m for one in found if one.found_m is not None]
        ax.plot([p[0] for p in at], [p[1] for p in at], "+", color=_FOUND, ms=10, mew=2.0, label="found")
    if result.false_at:
        at = [(one.p_W[0], one.p_W[1]) for one in result.false_at]
        ax.plot([p[0] for p in at], [p[1] for p in at], "x", color=_FALSE, ms=9, mew=2.0, label="found, nobody there")
    share = "none" if result.found_share is None else f"{100.0 * result.found_share:.0f} %"
    error = "" if result.error_m is None else f", median error {result.error_m:.2f} m"
    ax.set_title(f"{search.label}: found {result.found} of {result.visible} to be seen ({share}){error}", loc="left")
    ax.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    ax.grid(True, color="#e6e9ed", linewidth=0.7)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
