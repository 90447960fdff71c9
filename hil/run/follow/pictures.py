"""Pictures of a followed flight: the real one and the simulated one over the same time, and their difference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.run.follow.difference import Differences, Motion, rms
from hil.run.report.figures import legend, roll_pitch_yaw_deg, save, without_jumps

Rows = NDArray[np.float64]

_REAL, _SIMULATED, _TOLD = "#d55e00", "#0072b2", "#8a919b"
_AXES = ("#0072b2", "#e69f00", "#009e73")
_DEG = "\N{DEGREE SIGN}"


@dataclass(frozen=True)
class MotorRows:
    """Motors over the time of the flight: `unit` "0 to 1" for commands, "rad/s" for speeds; None where not logged."""

    t_s: Rows
    values: Rows
    unit: str


@dataclass(frozen=True)
class Compared:
    """The two flights at the times `t_s` from the beginning of the followed time."""

    title: str
    t_s: Rows
    real: Motion
    simulated: Motion
    set_points_W: Rows
    differences: Differences
    real_motors: MotorRows
    simulated_motors: MotorRows


def follow_pictures(out: Path, compared: Compared) -> list[tuple[str, Path]]:
    """Draw everything into files of the run's folder."""
    drawn = []
    for name, caption, figure in (
        ("follow_path", "Real and simulated flight: path, height and speed", path_figure(compared)),
        ("follow_motion", "Real and simulated flight: attitude, rates and motors", motion_figure(compared)),
        ("follow_difference", "Simulated less real flight", difference_figure(compared)),
    ):
        drawn.append((caption, save(figure, out / f"{name}.png")))
    return drawn


def path_figure(c: Compared) -> Figure:
    """Draw both paths from above on the left; height and speeds over time on the right."""
    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    figure.suptitle(c.title, x=0.012, ha="left", fontsize=13, fontweight="bold")
    grid = figure.add_gridspec(3, 2, width_ratios=[1.05, 1.0], wspace=0.03, hspace=0.04)
    plan = figure.add_subplot(grid[:, 0])
    plan.plot(c.set_points_W[:, 0], c.set_points_W[:, 1], "--", color=_TOLD, lw=1.2, label="set-points")
    _both(plan, c.real.p_WB[:, 0], c.real.p_WB[:, 1], c.simulated.p_WB[:, 0], c.simulated.p_WB[:, 1])
    plan.plot(*c.real.p_WB[0, :2], "^", ms=8, color=_REAL, mec="white")
    plan.plot(*c.simulated.p_WB[0, :2], "^", ms=8, color=_SIMULATED, mec="white")
    plan.set_aspect("equal", adjustable="datalim")
    plan.margins(0.12)
    plan.set(title="Path, seen from above", xlabel="east [m]", ylabel="north [m]")
    legend(plan)
    height = figure.add_subplot(grid[0, 1])
    height.plot(c.t_s, c.set_points_W[:, 2], "--", color=_TOLD, lw=1.2, label="set-points")
    _both(height, c.t_s, c.real.p_WB[:, 2], c.t_s, c.simulated.p_WB[:, 2])
    height.set(title="Height", ylabel="up [m]")
    legend(height)
    over_ground = figure.add_subplot(grid[1, 1], sharex=height)
    climb = figure.add_subplot(grid[2, 1], sharex=height)
    real, simulated = c.real.v_WB_W, c.simulated.v_WB_W
    _both(over_ground, c.t_s, np.hypot(*real[:, :2].T), c.t_s, np.hypot(*simulated[:, :2].T))
    over_ground.set(title="Speed over ground", ylabel="[m/s]")
    _both(climb, c.t_s, real[:, 2], c.t_s, simulated[:, 2])
    climb.set(title="Climb", ylabel="[m/s]", xlabel="time of the followed flight [s]")
    return _with_time(figure, c, height)


def motion_figure(c: Compared) -> Figure:
    """Draw attitude on the left, rates on the right by axis; the motors below."""
    figure = Figure(figsize=(12.0, 10.5), layout="constrained")
    grid = figure.add_gridspec(5, 2, hspace=0.04, wspace=0.03)
    first: Axes | None = None
    real, simulated = roll_pitch_yaw_deg(c.real.q_WB), roll_pitch_yaw_deg(c.simulated.q_WB)
    for row, name in enumerate(("roll", "pitch", "yaw")):
        axes = figure.add_subplot(grid[row, 0], sharex=first)
        _both(axes, c.t_s, without_jumps(real[:, row]), c.t_s, without_jumps(simulated[:, row]))
        axes.set(title=name.capitalize(), ylabel=f"[{_DEG}]")
        first = first or axes
        if row == 0:
            legend(axes)
        axes = figure.add_subplot(grid[row, 1], sharex=first)
        _both(axes, c.t_s, np.degrees(c.real.w_WB_B[:, row]), c.t_s, np.degrees(c.simulated.w_WB_B[:, row]), lw=0.8)
        axes.set(title=f"Rate about {'xyz'[row]}", ylabel=f"[{_DEG}/s]")
    count = min(c.real_motors.values.shape[1], c.simulated_motors.values.shape[1], 4)
    for i in range(count):
        axes = figure.add_subplot(grid[3 + i // 2, i % 2], sharex=first)
        _both(
            axes,
            c.real_motors.t_s,
            c.real_motors.values[:, i],
            c.simulated_motors.t_s,
            c.simulated_motors.values[:, i],
            lw=0.8,
        )
        axes.set(title=f"Motor {i}", ylabel=f"[{c.real_motors.unit}]")
    for axes in figure.axes[-2:]:
        axes.set_xlabel("time of the followed flight [s]")
    assert first is not None
    return _with_time(figure, c, first)


def difference_figure(c: Compared) -> Figure:
    """Draw the differences over time with their rms."""
    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True)
    d = c.differences
    for i, name in enumerate(("east", "north", "up")):
        grid[0, 0].plot(d.t_s, d.by_axis_m[:, i], color=_AXES[i], lw=1.2, label=name)
    grid[0, 0].set(title=f"Position, rms {_number(rms(d.position_m))} m", ylabel="simulated less real [m]")
    legend(grid[0, 0])
    for axes, values, name, unit in (
        (grid[0, 1], d.velocity_mps, "Velocity", "m/s"),
        (grid[1, 0], d.attitude_deg, "Attitude", _DEG),
        (grid[1, 1], np.degrees(d.rate_radps), "Rate", f"{_DEG}/s"),
    ):
        axes.plot(d.t_s, values, color=_SIMULATED, lw=1.0)
        axes.set(title=f"{name}, rms {_number(rms(values))} {unit}", ylabel=f"[{unit}]")
        axes.set_ylim(bottom=0.0)
    for axes in grid[1]:
        axes.set_xlabel("time of the followed flight [s]")
    return _with_time(figure, c, grid[0, 0])


def _both(axes: Axes, real_x: Rows, real_y: Rows, simulated_x: Rows, simulated_y: Rows, *, lw: float = 1.5) -> None:
    axes.plot(real_x, real_y, color=_REAL, lw=lw, label="real")
    axes.plot(simulated_x, simulated_y, color=_SIMULATED, lw=lw, label="simulated")


def _with_time(figure: Figure, c: Compared, axes: Axes) -> Figure:
    if len(c.t_s) > 1:
        axes.set_xlim(float(c.t_s[0]), float(c.t_s[-1]))
    return figure


def _number(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.3g}"
