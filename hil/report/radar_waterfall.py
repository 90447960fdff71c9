"""Range and speed over time: how things moved, and the micro-Doppler of limbs.

matplotlib is slow to import: import this module at the end of a run, not at its start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.report.radar_pictures import POWER_MAP, colours_of, decibels, range_extent, show_levels, speed_extent
from sim.radar.chirp import Chirp

_TRACK = "#35d0ff"


def waterfall_figure(
    title: str,
    t_s: NDArray[np.float64],
    range_time: NDArray[np.float32],
    speed_time: NDArray[np.float32],
    tracks: Sequence[NDArray[Any]],
    chirp: Chirp,
) -> Figure:
    """Rows of `range_time` and `speed_time` are frames; tracks are drawn over both."""
    figure = Figure(figsize=(13.5, 8.2), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    above, below = figure.subplots(2, 1, sharex=True)
    time_extent = _time_extent(t_s)
    _rows(figure, above, range_time, time_extent, range_extent(chirp, max(range_time.shape[-1], 1)))
    above.set(ylabel="range [m]")
    above.set_title("range over time: greatest power of all speeds", fontsize=9.5, loc="left")
    _rows(figure, below, speed_time, time_extent, speed_extent(chirp, max(speed_time.shape[-1], 1)))
    below.set(ylabel="radial speed [m/s], + goes away", xlabel="time [s]")
    below.set_title("speed over time: power of all ranges", fontsize=9.5, loc="left")
    for axes, field in ((above, "range_m"), (below, "speed_mps")):
        at = [t for t, found in zip(t_s, tracks, strict=True) for _ in found]
        values = [value for found in tracks for value in found[field].tolist()]
        axes.plot(at, values, ".", ms=3.5, color=_TRACK, label="tracks")
        if values:
            axes.legend(loc="upper right", fontsize=8, labelcolor="white")
    return figure


def micro_doppler_figure(
    title: str,
    t_s: NDArray[np.float64],
    speed_time: NDArray[np.float32],
    track_t_s: NDArray[np.float64],
    track_speed_mps: NDArray[np.float64],
    chirp: Chirp,
) -> Figure:
    """Rows of `speed_time` are frames, of the ranges about one track; its speed is a thin line through them."""
    figure = Figure(figsize=(13.5, 4.6), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes = figure.subplots()
    _rows(figure, axes, speed_time, _time_extent(t_s), speed_extent(chirp, speed_time.shape[-1]))
    axes.plot(track_t_s, track_speed_mps, "-", lw=0.8, color=_TRACK, label="the track's speed")
    axes.legend(loc="upper right", fontsize=8, labelcolor="white")
    axes.set(ylabel="radial speed [m/s], + goes away", xlabel="time [s]")
    axes.set_title("micro-Doppler: speed over time, power of the ranges about the track", fontsize=9.5, loc="left")
    return figure


def _time_extent(t_s: NDArray[np.float64]) -> tuple[float, float]:
    """Edges of the frames [s]."""
    step = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    return (float(t_s[0]) - 0.5 * step, float(t_s[-1]) + 0.5 * step) if len(t_s) else (0.0, 1.0)


def _rows(
    figure: Figure, axes: Axes, power: NDArray[np.float32], across: tuple[float, float], upward: tuple[float, float]
) -> None:
    if not power.size:
        return
    level = decibels(power.T)
    norm = colours_of(level)
    show_levels(axes, level, norm, across, upward)
    bar = figure.colorbar(ScalarMappable(norm, POWER_MAP), ax=axes, extend="min", pad=0.01)
    bar.set_label("[dB of 1 count2]", fontsize=8)
