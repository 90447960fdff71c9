"""Pictures of a campaign: margins to each limit, margins over the numeric axes, and small pictures of flights.

matplotlib is slow to import: import this module at the end of a campaign, not at its start.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hil.apps.campaign.results.summary import Margins, Point
from hil.run.report.figures import save, style
from hil.run.report.group_report import PICTURE_NAME as GROUP_NAME
from hil.run.report.pictures import FLIGHT_NAME

MARGINS_NAME, AXES_NAME = "margins.png", "margins_over_axes.png"
_COLUMNS = 4
_BLUE, _RED, _INK = "#0072b2", "#d55e00", "#20262e"
_MOST_PLOTS = 24
_BINS = 30
_SPAN = 0.98  # of the margins are shown in a histogram; the rest are in its outermost bars
_SMALL_PX = (420, 82)  # width of a picture of a flight, and its JPEG quality


def margins_picture(folder: Path, margins: Mapping[str, Margins]) -> Path:
    """Draw a histogram of the margins to each limit, the tightest limit first. Raises OSError."""
    shown = sorted(margins.items(), key=lambda item: item[1].least)[:_MOST_PLOTS]
    with style():
        figure, plots = _plots(len(shown), 2.3)
        for plot, (name, of) in zip(plots, shown, strict=True):
            _draw_margins(plot, name, np.array(of.sample))
        save(figure, folder / MARGINS_NAME)
    return folder / MARGINS_NAME


def _draw_margins(plot: Axes, name: str, margins: np.ndarray) -> None:
    low, high = np.quantile(margins, [(1.0 - _SPAN) / 2.0, (1.0 + _SPAN) / 2.0])
    low, high = max(min(low, 0.0), -1.0) - 1e-3, max(high, 0.0) + 1e-3
    edges = np.linspace(low, high, _BINS)
    edges = np.sort(np.append(edges, 0.0))  # no bar has missed and met limits in it
    counts, _ = np.histogram(np.clip(margins, low, high), edges)
    colours = [_RED if edge < 0.0 else _BLUE for edge in edges[:-1]]
    plot.bar(edges[:-1], counts, np.diff(edges), align="edge", color=colours)
    plot.axvline(0.0, color=_INK, lw=1.0)
    plot.set(title=short_name(name), yticks=[])
    plot.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
    plot.locator_params(axis="x", nbins=5)


def axes_picture(folder: Path, points: Sequence[Point], axes: Sequence[str]) -> Path:
    """Draw the smallest margin of each flight over every numeric axis. Raises OSError."""
    with style():
        figure, plots = _plots(min(len(axes), _MOST_PLOTS), 2.6)
        for plot, axis in zip(plots, axes, strict=False):
            for status, colour in (("PASS", _BLUE), ("FAIL", _RED)):
                of = [point for point in points if point.status == status]
                margins = np.clip([point.margin for point in of], -1.0, 1.0)
                values = [point.axes[axis] for point in of]
                plot.plot(values, margins, ".", ms=3.5 if len(points) > 300 else 6, color=colour, alpha=0.6, mew=0)
            plot.axhline(0.0, color=_INK, lw=1.0)
            plot.set_title(axis, fontsize=9)
            plot.set_ylim(-1.05, 1.05)
            plot.yaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
            plot.locator_params(axis="x", nbins=5)
        save(figure, folder / AXES_NAME)
    return folder / AXES_NAME


def _plots(count: int, height: float) -> tuple[Figure, list[Axes]]:
    rows = -(-count // _COLUMNS)
    columns = -(-count // rows)
    figure = Figure(figsize=(12.0, height * rows), layout="constrained")
    plots = list(figure.subplots(rows, columns, squeeze=False).flat)
    for unused in plots[count:]:
        unused.set_visible(False)
    return figure, plots[:count]


def small_picture(run: Path) -> str:
    """Return the picture of a recorded flight as a small JPEG in base64, empty if there is none."""
    found = next((run / name for name in (FLIGHT_NAME, GROUP_NAME) if (run / name).is_file()), None)
    picture = None if found is None else cv2.imread(str(found))
    if picture is None:
        return ""
    width, quality = _SMALL_PX
    height = round(picture.shape[0] * width / picture.shape[1])
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return base64.b64encode(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()).decode()


def short_name(name: str) -> str:
    """Return the name of a measurement without its unit."""
    return name.rsplit("_", 1)[0].replace("_", " ")
