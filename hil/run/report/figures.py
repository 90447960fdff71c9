"""Pictures of a flight, and of how long frames took to companions and back.

matplotlib is slow to import: import this module at the end of a run, not at its start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from hil.config.missions.path import PlanPoint
from hil.run.companion.files import FrameTimes
from hil.run.recorder.track import TrackArrays

# palette of Okabe and Ito, distinguishable with any colour vision
_BLUE, _ORANGE, _GREEN, _RED, _GREY, _INK = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#8a919b", "#20262e"
_MOTORS = (_BLUE, _ORANGE, _GREEN, "#cc79a7", "#56b4e9", _RED, "#999933", "#332288")
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": "#b8bec7",
    "axes.labelcolor": _INK,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlecolor": _INK,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e9ed",
    "grid.linewidth": 0.8,
    "xtick.color": "#5b636e",
    "ytick.color": "#5b636e",
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
_DPI = 130
_LATENCIES = (  # field, label, colour of the palette above
    ("render_ms", "t1: render", "#0072b2"),
    ("link_ms", "t1: link to client", "#56b4e9"),
    ("t2_ms", "t2: client", "#e69f00"),
    ("t3_ms", "t3: client to autopilot", "#d55e00"),
)
_MAX_CLIENTS = 4  # in the figure
_MAX_POINTS = 20_000  # of one line; of more, every n-th is drawn
_MIN_MS = 0.001


def roll_pitch_yaw_deg(q_WB: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert (n, 4) w-x-y-z to (n, 3) roll, pitch, yaw [deg], intrinsic z-y'-x'' of body FLU in world ENU."""
    w, x, y, z = q_WB.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.degrees(np.stack([roll, pitch, yaw], axis=1))


def without_jumps(angle_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle with a gap where it wraps, so that no line crosses the plot."""
    result = angle_deg.copy()
    result[1:][np.abs(np.diff(angle_deg)) > 180.0] = np.nan
    return result


def draw_path(axes: Axes, track: TrackArrays, plan: Sequence[PlanPoint]) -> None:
    """Draw a top view of plan and flight, east to the right and north up, both in metres on one scale."""
    points = np.array([point.p_W for point in plan], np.float64).reshape(-1, 3)
    if len(points):
        axes.plot(points[:, 0], points[:, 1], "--", color=_GREY, lw=1.4, label="plan", zorder=2)
        labels_at: dict[tuple[float, float], list[str]] = {}
        for (x, y, _), label in plan:
            if label:
                labels_at.setdefault((round(x, 1), round(y, 1)), []).append(label)
        axes.plot(points[:, 0], points[:, 1], "o", ms=6, mfc="white", mec=_GREY, mew=1.4, zorder=4)
        middle = points[:, :2].mean(axis=0)
        for point, labels in labels_at.items():
            outward = np.array(point) - middle
            outward = outward / (np.hypot(*outward) or 1.0)
            if not labels[0].isdecimal():  # a wide text goes below or above its point, not beside it
                outward = np.array((0.0, 1.0 if outward[1] > 0.5 else -1.0))
            axes.annotate(
                ", ".join(labels),
                point,
                xytext=tuple(outward * 13.0),
                textcoords="offset points",
                ha="center",
                va="center",
                color="#5b636e",
                fontweight="bold",
                zorder=6,
            )
    if len(track.t_s):
        p = track.p_WB
        axes.plot(p[:, 0], p[:, 1], color=_BLUE, lw=2.2, label="flown", zorder=3, solid_capstyle="round")
        axes.plot(*p[0, :2], "^", ms=9, color=_GREEN, mec="white", label="start", zorder=5)
        axes.plot(*p[-1, :2], "v", ms=9, color=_RED, mec="white", label="end", zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set(title="Path, seen from above", xlabel="east [m]", ylabel="north [m]")
    legend(axes)


def draw_altitude(axes: Axes, track: TrackArrays, plan: Sequence[PlanPoint]) -> None:
    """Draw altitude above the origin over time, with the altitudes of the plan's waypoints."""
    for i, z in enumerate(sorted({round(point.p_W[2], 2) for point in plan if point.p_W[2] > 0.1})):
        axes.axhline(z, ls="--", color=_GREY, lw=1.2, label="plan" if i == 0 else None)
    axes.plot(track.t_s, track.p_WB[:, 2], color=_BLUE, lw=1.8, label="flown")
    axes.set(title="Altitude", ylabel="up [m]")
    legend(axes)


def draw_attitude(axes: Axes, track: TrackArrays) -> None:
    """Draw roll and pitch on the left scale, yaw on the right one."""
    angles = roll_pitch_yaw_deg(track.q_WB)
    axes.plot(track.t_s, without_jumps(angles[:, 0]), color=_BLUE, lw=1.1, label="roll")
    axes.plot(track.t_s, without_jumps(angles[:, 1]), color=_RED, lw=1.1, label="pitch")
    axes.set(title="Attitude", ylabel="roll, pitch [\N{DEGREE SIGN}]")
    yaw_axes = axes.twinx()
    yaw_axes.plot(track.t_s, without_jumps(angles[:, 2]), color=_GREY, lw=1.1, label="yaw (right)")
    yaw_axes.grid(visible=False)
    yaw_axes.spines["right"].set_visible(True)
    yaw_axes.set_ylabel("yaw [\N{DEGREE SIGN}]")
    yaw_axes.set_ylim(-190, 190)
    yaw_axes.set_yticks([-180, -90, 0, 90, 180])
    handles = [*axes.get_lines(), *yaw_axes.get_lines()]
    legend(axes, handles)


def draw_motors(axes: Axes, track: TrackArrays) -> None:
    """Draw motor commands over time, 0 to 1. Motors and rotors are numbered from 0, as in the bench file."""
    for i in range(track.controls.shape[1]):
        axes.plot(track.t_s, track.controls[:, i], color=_MOTORS[i % len(_MOTORS)], lw=0.9, label=f"{i}")
    axes.set(title="Motor commands", ylabel="0 to 1", ylim=(-0.03, 1.03))
    legend(axes)


def legend(axes: Axes, handles: Sequence[Any] | None = None) -> None:
    """Draw the legend in one row above the plot, to the right of the title."""
    handles = [h for h in handles or axes.get_lines() if not str(h.get_label()).startswith("_")]
    if handles:
        axes.legend(
            handles=list(handles),
            loc="lower right",
            bbox_to_anchor=(1.0, 0.99),
            ncols=len(handles),
            borderaxespad=0.1,
            handlelength=1.3,
            columnspacing=1.1,
        )


def flight_figure(track: TrackArrays, plan: Sequence[PlanPoint], title: str) -> Figure:
    """Draw the flight: path on the left; altitude, attitude and motors over time on the right."""
    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=_INK)
    grid = figure.add_gridspec(3, 2, width_ratios=[1.05, 1.0], wspace=0.03, hspace=0.04)
    draw_path(figure.add_subplot(grid[:, 0]), track, plan)
    altitude = figure.add_subplot(grid[0, 1])
    attitude = figure.add_subplot(grid[1, 1], sharex=altitude)
    motors = figure.add_subplot(grid[2, 1], sharex=altitude)
    draw_altitude(altitude, track, plan)
    draw_attitude(attitude, track)
    draw_motors(motors, track)
    for axes in (altitude, attitude):
        axes.tick_params(labelbottom=False)
    motors.set_xlabel("simulated time [s]")
    if len(track.t_s) > 1:
        altitude.set_xlim(track.t_s[0], track.t_s[-1])
    return figure


def motion_figure(track: TrackArrays) -> Figure:
    """Draw speed over ground and climb rate on the left, rotor speeds on the right."""
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    speed, rotors = figure.subplots(1, 2)
    v = track.v_WB_W
    speed.plot(track.t_s, np.hypot(v[:, 0], v[:, 1]), color=_BLUE, label="over ground")
    speed.plot(track.t_s, v[:, 2], color=_RED, lw=1.1, label="climb")
    speed.set(title="Speed", ylabel="[m/s]", xlabel="simulated time [s]")
    legend(speed)
    for i in range(track.rotor_speed_radps.shape[1]):
        rotors.plot(track.t_s, track.rotor_speed_radps[:, i], color=_MOTORS[i % len(_MOTORS)], lw=0.9, label=f"{i}")
    rotors.set(title="Rotor speeds", ylabel="[rad/s]", xlabel="simulated time [s]")
    legend(rotors)
    return figure


def spectrum_figure(
    hz: NDArray[np.float64], accel: NDArray[np.float64], gyro: NDArray[np.float64], name: str
) -> Figure:
    """Draw root spectral densities (n, 3) of specific force [m/s2/sqrt(Hz)] and rate [rad/s/sqrt(Hz)] by axis."""
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    for axes, values, unit in zip(
        figure.subplots(1, 2), (accel, gyro), ("m/s\N{SUPERSCRIPT TWO}", "rad/s"), strict=True
    ):
        for i, label in enumerate("xyz"):
            axes.plot(hz, np.maximum(values[:, i], 1e-12), color=_MOTORS[i], lw=1.1, label=label)
        axes.set_yscale("log")
        what = "specific force" if unit.startswith("m") else "rate"
        axes.set(title=f"Spectrum of {name}: {what}", xlabel="[Hz]", ylabel=f"[{unit}/\N{SQUARE ROOT}Hz]")
        legend(axes)
    return figure


def timing_figure(rtt_bins_ns: Sequence[tuple[float, int]], phase_us: Mapping[str, float]) -> Figure:
    """Draw a histogram of the autopilot's round trips, and the mean wall time per tick by phase."""
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    trips, phases = figure.subplots(1, 2)
    trips.set(title="Round trip to the autopilot", xlabel="wall time [\N{MICRO SIGN}s], logarithmic", ylabel="ticks")
    if rtt_bins_ns:
        _draw_durations(trips, rtt_bins_ns)
    names, values = list(phase_us), [float(v) for v in phase_us.values()]
    bars = phases.barh(names, values, color=[_MOTORS[i % len(_MOTORS)] for i in range(len(names))], height=0.62)
    total = sum(values) or 1.0
    phases.bar_label(bars, [f"{v:.1f} \N{MICRO SIGN}s  {100 * v / total:.0f} %" for v in values], padding=4, color=_INK)
    phases.invert_yaxis()
    phases.grid(axis="y", visible=False)
    phases.margins(x=0.25)
    phases.set(title="Wall time per tick by phase", xlabel="mean [\N{MICRO SIGN}s]")
    return figure


def realtime_figure(
    lateness_bins_ns: Sequence[tuple[float, int]], age_bins_ns: Sequence[tuple[float, int]], harmful_ms: float
) -> Figure:
    """Draw histograms of the lateness of sent samples and of the age of motor commands when a tick used them."""
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    lateness, age = figure.subplots(1, 2)
    unit = "wall time [\N{MICRO SIGN}s], logarithmic"
    lateness.set(title="Samples: lateness when sent", xlabel=unit, ylabel="ticks")
    age.set(title="Motor commands: age when used", xlabel=unit, ylabel="ticks")
    for axes, bins in ((lateness, lateness_bins_ns), (age, age_bins_ns)):
        if bins:
            _draw_durations(axes, bins)
    lateness.axvline(harmful_ms * 1e3, color=_INK, linestyle="--", linewidth=1.2)
    note = " PX4's estimator suffers\n if 1 in 100 is later"
    transform = lateness.get_xaxis_transform()
    lateness.text(harmful_ms * 1e3, 0.97, note, transform=transform, va="top", ha="left", fontsize=8, color=_INK)
    lateness.xaxis.set_major_locator(LogLocator())
    lateness.set_xlim(right=harmful_ms * 1e3 * 20)
    return figure


def _draw_durations(axes: Any, bins_ns: Sequence[tuple[float, int]]) -> None:
    """Draw a histogram in microseconds, both axes logarithmic so that the tail shows."""
    middle_us = np.array([middle for middle, _ in bins_ns]) / 1e3
    counts = np.array([count for _, count in bins_ns])
    low, high = max(middle_us.min(), 0.1) * 0.95, max(middle_us.max(), 0.2) * 1.05
    edges = np.geomspace(low, high, 36)  # wider than the 3 % bins of the input, so that no bar is empty by chance
    axes.hist(middle_us, bins=edges.tolist(), weights=counts, color=_BLUE)
    _set_logarithmic(axes, (1.0, 2.0, 5.0) if high / low < 300 else (1.0,))


def _set_logarithmic(axes: Axes, subs: tuple[float, ...] = (1.0,)) -> None:
    """Make both axes of a histogram logarithmic; `subs`: multiples of each power of ten that are labelled."""
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(LogLocator(subs=subs))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


def save(figure: Figure, path: Path) -> Path:
    """Write the figure to `path` as a PNG file, and return the path."""
    layout = figure.get_layout_engine()
    if layout is not None:  # done here, because matplotlib would draw everything twice for it
        figure.dpi = _DPI
        layout.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(path, dpi=_DPI)
    return path


def style() -> Any:
    """Return the context manager of the report's style; make and save figures within it."""
    import matplotlib as mpl

    return mpl.rc_context(_STYLE)


def companion_figure(timing: Mapping[str, FrameTimes]) -> Figure:
    """Draw a row per client: times of every frame on the left, their histogram on the right."""
    names = list(timing)[:_MAX_CLIENTS]
    figure = Figure(figsize=(12.0, 0.5 + 3.1 * len(names)), layout="constrained")
    rows = figure.subplots(len(names), 2, squeeze=False, width_ratios=(1.7, 1.0))
    for name, (over_time, counts) in zip(names, rows, strict=True):
        _draw_times(over_time, timing[name])
        _draw_histogram(counts, timing[name])
        over_time.set(title=f"{name}: every frame", xlabel="simulated time [s]", ylabel="wall time [ms]")
        counts.set(title="Histogram", xlabel="wall time [ms]", ylabel="frames")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), markerscale=3.0)
    return figure


def _draw_times(axes: Axes, times: FrameTimes) -> None:
    for field, label, colour in _LATENCIES:
        ms = _bounded(getattr(times, field))
        step = -(-len(ms) // _MAX_POINTS)
        axes.plot(times.t_s[::step], ms[::step], ".", ms=2.2, color=colour, label=label, rasterized=True)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _draw_histogram(axes: Axes, times: FrameTimes) -> None:
    series = [(_bounded(getattr(times, field)), colour) for field, _, colour in _LATENCIES]
    series = [(ms[np.isfinite(ms)], colour) for ms, colour in series]
    all_ms = np.concatenate([ms for ms, _ in series])
    if not all_ms.size:
        return
    edges = np.geomspace(all_ms.min() * 0.95, all_ms.max() * 1.05, 61)
    for ms, colour in series:
        if ms.size:
            axes.hist(ms, bins=edges.tolist(), histtype="step", color=colour, lw=1.4)
    _set_logarithmic(axes)


def _bounded(ms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the times with a lower bound, because a logarithmic axis has no zero."""
    return np.maximum(ms, _MIN_MS)
