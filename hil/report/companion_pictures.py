"""Pictures of how long frames took to the companion and back. Slow to import, as `figures` is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from hil.companion.timing_file import FrameTimes

_PARTS = (  # field, label, colour: told apart with any colour vision
    ("render_ms", "t1: engine to SUT", "#0072b2"),
    ("link_ms", "t1: SUT to CUT", "#56b4e9"),
    ("t2_ms", "t2: CUT", "#e69f00"),
    ("t3_ms", "t3: CUT to autopilot", "#d55e00"),
)
_SHOWN = 4  # clients
_POINTS = 20_000  # of one line; more are thinned out, evenly
_LOWEST_MS = 0.001


def companion_figure(timing: Mapping[str, FrameTimes]) -> Figure:
    """A row for each client: on the left every frame over time, on the right how often which duration came."""
    names = list(timing)[:_SHOWN]
    figure = Figure(figsize=(12.0, 0.5 + 3.1 * len(names)), layout="constrained")
    rows = figure.subplots(len(names), 2, squeeze=False, width_ratios=(1.7, 1.0))
    for name, (over_time, counts) in zip(names, rows, strict=True):
        _over_time(over_time, timing[name])
        _counts(counts, timing[name])
        over_time.set(title=f"{name}: every frame", xlabel="simulated time [s]", ylabel="wall time [ms]")
        counts.set(title="How often", xlabel="wall time [ms]", ylabel="frames")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), markerscale=3.0)
    return figure


def _over_time(axes: Axes, times: FrameTimes) -> None:
    for field, label, colour in _PARTS:
        ms = _shown(getattr(times, field))
        step = -(-len(ms) // _POINTS)
        axes.plot(times.t_s[::step], ms[::step], ".", ms=2.2, color=colour, label=label, rasterized=True)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _counts(axes: Axes, times: FrameTimes) -> None:
    parts = [(_shown(getattr(times, field)), colour) for field, _, colour in _PARTS]
    parts = [(ms[np.isfinite(ms)], colour) for ms, colour in parts]
    there = np.concatenate([ms for ms, _ in parts])
    if not there.size:
        return
    edges = np.geomspace(there.min() * 0.95, there.max() * 1.05, 61)
    for ms, colour in parts:
        if ms.size:
            axes.hist(ms, bins=edges.tolist(), histtype="step", color=colour, lw=1.4)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(LogLocator())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


def _shown(ms: NDArray[np.float64]) -> NDArray[np.float64]:
    """On a logarithmic scale there is no nothing."""
    return np.maximum(ms, _LOWEST_MS)
