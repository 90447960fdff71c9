"""Polars as a picture. It imports matplotlib, which is slow, so import this module only to plot."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hil.apps.vehicle.polars import Polars
from hil.run.report import figures

# Okabe and Ito's palette, distinguishable with any colour vision.
_OWN, _LATTICE, _POINTS = "#0072b2", "#e69f00", "#d55e00"
_NEAR_DEG = 30.0


def draw_polars(polars: Polars, title: str, path: Path) -> None:
    """Plot C_L, C_D, C_m near and over all angles, and L/D, as a PNG. Raises OSError."""
    with figures.style():
        figure = Figure(figsize=(11.0, 7.5), layout="constrained")
        axes = figure.subplots(2, 3)
        for axis, name in zip((*axes[0], axes[1, 0]), ("CL", "CD", "Cm", "L/D"), strict=True):
            _draw(axis, polars, name, _NEAR_DEG)
        _draw(axes[1, 1], polars, "CL", 180.0)
        _draw(axes[1, 2], polars, "CD", 180.0)
        axes[0, 0].legend()
        figure.suptitle(title)
        figures.save(figure, path)


def _draw(axis: Axes, polars: Polars, name: str, reach_deg: float) -> None:
    for label, source, colour, style in (
        ("panels", polars.own, _OWN, "-"),
        ("AeroSandbox, inviscid", polars.lattice, _LATTICE, "--"),
        ("source", polars.points, _POINTS, "o"),
    ):
        x, y = [], []
        for alpha_deg, values in sorted(source.items()):
            if abs(alpha_deg) > reach_deg:
                continue
            if name == "L/D" and source is polars.own:
                x.append(alpha_deg)
                y.append(values["CL"] / values["CD"])
            elif name in values:
                x.append(alpha_deg)
                y.append(values[name])
        if x:
            axis.plot(x, y, style, color=colour, label=label)
    axis.set_xlabel("alpha [deg]")
    axis.set_ylabel(name)
