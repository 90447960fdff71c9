"""Figures of a plane's flight: airspeed, energy, angles of the flow, surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from hil.run.report.figures import legend
from hil.run.verdict.plane_track import PlaneTrackArrays

_BLUE, _RED, _GREY, _GREEN = "#2563eb", "#dc2626", "#6b7280", "#059669"
_SURFACES = (_BLUE, _RED, _GREEN, "#d97706", "#7c3aed", "#0891b2", "#be185d", _GREY)


def plane_figure(track: PlaneTrackArrays, surface_names: Sequence[str]) -> Figure:
    """Draw airspeed and energy on the left, angles of the flow and energy rate on the right, surfaces below."""
    figure = Figure(figsize=(12.0, 8.6), layout="constrained")
    ((speed, flow), (energy, power), (left, right)) = figure.subplots(3, 2, sharex=True)
    t = track.t_s
    speed.plot(t, track.airspeed_mps, color=_BLUE, label="true")
    if np.isfinite(track.indicated_mps).any():
        speed.plot(t, track.indicated_mps, color=_GREEN, lw=0.8, label="indicated (pitot)")
    speed.plot(t, track.stall_mps, color=_RED, lw=1.0, ls="--", label="stall at this bank")
    speed.set(title="Airspeed", ylabel="[m/s]")
    flow.plot(t, track.attack_deg, color=_BLUE, lw=1.0, label="angle of attack")
    flow.plot(t, track.sideslip_deg, color=_GREEN, lw=1.0, label="sideslip")
    flow.plot(t, track.bank_deg, color=_GREY, lw=0.9, label="bank")
    flow.set(title="Angles of the flow", ylabel="[deg]")
    energy.plot(t, track.energy_m, color=_BLUE, label="height + V²/2g")
    energy.plot(t, track.height_m, color=_GREY, label="height")
    energy.set(title="Energy as a height", ylabel="[m]")
    power.plot(t, track.energy_rate_mps, color=_BLUE, lw=1.0, label="over 1 s")
    power.set(title="Energy rate", ylabel="[m/s]")
    half = (len(surface_names) + 1) // 2  # the first half of the surfaces on the left
    for axes, names in ((left, surface_names[:half]), (right, surface_names[half:])):
        for name in names:
            i = surface_names.index(name)
            colour = _SURFACES[i % len(_SURFACES)]
            axes.plot(t, track.command_deg[:, i], color=colour, lw=0.8, ls=":", label="commanded")
            axes.plot(t, track.surface_deg[:, i], color=colour, lw=0.9, label=name)
        axes.set(title="Deflection", ylabel="[deg]", xlabel="simulated time [s]")
    for axes in (speed, flow, energy, power, left, right):
        axes.grid(visible=True, alpha=0.3)
        legend(axes)
    return figure
