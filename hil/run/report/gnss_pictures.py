"""Pictures of a receiver's sky for the report: the satellites at two instants, and their number over the flight."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hil.run.report import figures

# State of a satellite: colour of the palette of Okabe and Ito, marker, label.
_STATES = {
    "used": ("#009e73", "o", "used"),
    "reflected": ("#e69f00", "D", "used by a reflection"),
    "visible": ("#56b4e9", "o", "seen, not used"),
    "hidden": ("#d55e00", "x", "hidden"),
}
_MOST_HDOP = 10.0


def gnss_pictures(out: Path, courses: Mapping[str, Any]) -> list[tuple[str, Path]]:
    """Draw the sky of each receiver (`SkyCourse`) into a file of its own."""
    pictures = []
    with figures.style():
        for name, course in courses.items():
            path = figures.save(_figure(name, course), out / f"sky_{name}.png")
            pictures.append((f"Satellites of {name}", path))
    return pictures


def _figure(name: str, course: Any) -> Figure:
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(2, 4, width_ratios=(1.1, 1.1, 1.0, 1.0))
    for column, moment, what in ((0, course.first, "first sample"), (1, course.poorest, "fewest satellites")):
        axes: Any = figure.add_subplot(grid[:, column], projection="polar")
        _draw_sky(axes, moment, f"{name}, {what}: {moment.t_s:.1f} s")
    handles = [
        figure.axes[0].plot([], [], marker, ls="", color=colour, label=label)[0]
        for colour, marker, label in _STATES.values()
    ]
    figure.legend(handles=handles, loc="outside lower left", ncols=4)
    rows, t_s = np.array(course.rows, np.float64), np.array(course.t_s)
    counts = figure.add_subplot(grid[0, 2:])
    counts.step(t_s, rows[:, 2], where="post", color="#8a919b", lw=1.0, label="above the mask")
    counts.step(t_s, rows[:, 3], where="post", color="#56b4e9", lw=1.2, label="seen")
    counts.step(t_s, rows[:, 1], where="post", color="#009e73", lw=1.5, label="tracked or used")
    counts.set(title="Satellites", ylim=(0.0, None))
    figures.legend(counts)
    quality = figure.add_subplot(grid[1, 2:], sharex=counts)
    hdop = np.where(rows[:, 0] > 1, np.minimum(rows[:, 5], _MOST_HDOP), np.nan)
    quality.step(t_s, hdop, where="post", color="#0072b2", lw=1.2, label="HDOP")
    quality.step(t_s, rows[:, 0], where="post", color="#d55e00", lw=1.2, label="fix type")
    quality.set(xlabel="simulated time [s]", ylim=(0.0, None))
    figures.legend(quality)
    return figure


def _draw_sky(axes: Any, moment: Any, title: str) -> None:
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set(rlim=(0.0, 90.0), title=title, xticks=np.radians((0, 90, 180, 270)), xticklabels=("N", "E", "S", "W"))
    axes.set_yticks((30.0, 60.0), labels=("60\N{DEGREE SIGN}", "30\N{DEGREE SIGN}"))
    for view in moment.views:
        e, n, u = view.direction
        colour, marker, _ = _STATES[view.state]
        azimuth, zenith_deg = np.arctan2(e, n), np.degrees(np.arccos(min(max(u, -1.0), 1.0)))
        axes.plot(azimuth, zenith_deg, marker, ms=6, color=colour)
        axes.annotate(view.name, (azimuth, zenith_deg), (3, 3), textcoords="offset points", fontsize=6)
