"""Pictures of the result page. matplotlib is slow to import: import this module at the end only."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hil.apps.identify.fit_result import Fit, Prediction, Residual
from hil.apps.identify.judgement import QUANTITIES, mean_by_horizon
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.report import figures

_BEFORE, _AFTER = "#8a919b", "#0072b2"
_AXES = {"x": "#0072b2", "y": "#e69f00", "z": "#009e73"}
_MOST_POINTS = 4000  # of one line
_MOST_LOGS = 6


def draw_predictions(fit: Fit, path: Path) -> None:
    """Plot held-out prediction errors by horizon, of each log (thin) and their mean. Raises OSError."""
    with figures.style():
        figure = Figure(figsize=(12.0, 3.4), layout="constrained")
        for axes, (name, (title, unit)) in zip(figure.subplots(1, 4), QUANTITIES.items(), strict=True):
            for predictions, colour, label in ((fit.before, _BEFORE, "began with"), (fit.after, _AFTER, "fitted")):
                for log in dict.fromkeys(p.log for p in predictions):
                    _line(axes, [p for p in predictions if p.log == log], name, colour, lw=0.6)
                _line(axes, mean_by_horizon(predictions), name, colour, lw=2.2, label=label)
            axes.set(title=title, xlabel="horizon [s]", ylabel=f"mean error [{unit}]")
            if any(np.isfinite(line.get_ydata()).any() for line in axes.get_lines()):
                axes.set(xscale="log", yscale="log")
                axes.legend()
            else:
                axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center")
        figures.save(figure, path)


def draw_residuals(residuals: Sequence[Residual], path: Path) -> None:
    """Plot the rms of the residuals by air speed, a line for each axis. Raises OSError."""
    with figures.style():
        figure = Figure(figsize=(12.0, 3.2), layout="constrained")
        kinds = (("force", "Specific force", "m/s2"), ("turn", "Angular acceleration", "rad/s2"))
        for axes, (kind, title, unit) in zip(figure.subplots(1, 2), kinds, strict=True):
            for axis, colour in _AXES.items():
                rows = [r for r in residuals if r.quantity == kind and r.axis == axis and r.speed_mps is not None]
                rows.sort(key=lambda r: r.speed_mps or 0.0)
                axes.plot(
                    [r.speed_mps or 0.0 for r in rows], [r.rms for r in rows], "o-", ms=4, color=colour, label=axis
                )
            axes.set(title=f"{title}: residual rms", xlabel="air speed [m/s]", ylabel=f"[{unit}]")
            axes.set_ylim(bottom=0.0)
            axes.legend()
        figures.save(figure, path)


def draw_flights(whole: Sequence[FlightLog], flights: Sequence[FlightLog], path: Path) -> None:
    """Plot motors and height of each log, with the stretches that are used shaded. Raises OSError."""
    shown = whole[:_MOST_LOGS]
    with figures.style():
        figure = Figure(figsize=(12.0, 0.4 + 2.1 * len(shown)), layout="constrained")
        rows = figure.subplots(len(shown), 1, squeeze=False)[:, 0]
        for axes, log in zip(rows, shown, strict=True):
            step = max(1, len(log.motors) // _MOST_POINTS)
            axes.plot(log.motors.t_s[::step], log.motors.values[::step], lw=0.6)
            unit = "0 to 1" if log.motors_kind == "command" else "rad/s"
            axes.set(title=f"{log.name}: motors; used stretches shaded", ylabel=f"[{unit}]")
            for flight in flights:
                if flight.source == log.source:
                    axes.axvspan(flight.start_s, flight.end_s, color="#009e73", alpha=0.12, lw=0)
            if log.pose is not None:
                height = axes.twinx()
                step = max(1, len(log.pose) // _MOST_POINTS)
                height.plot(log.pose.t_s[::step], log.pose.values[::step, 2], color="#20262e", lw=1.2)
                height.set_ylabel("height [m]")
                height.grid(visible=False)
        rows[-1].set_xlabel("time of the log [s]")
        figures.save(figure, path)


def _line(axes: Axes, predictions: Sequence[Prediction], name: str, colour: str, *, lw: float, label: str = "") -> None:
    values = np.array([getattr(p, name) for p in predictions], np.float64)
    horizons = np.array([p.horizon_s for p in predictions], np.float64)
    there = np.isfinite(values) & (values > 0.0)
    style = "o-" if label else "-"
    axes.plot(horizons[there], values[there], style, ms=4, color=colour, lw=lw, label=label or "_")
