"""Figures of a plane's flight: airspeed, energy, angles of the flow, surfaces."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from hil.run.report.figures import legend
from hil.run.verdict.plane_track import PlaneTrackArrays

_BLUE, _RED, _GREY, _GREEN = "#2563eb", "#dc2626", "#6b7280", "#059669"
_SURFACES = (_BLUE, _RED, _GREEN, "#d97706", "#7c3aed", "#0891b2", "#be185d", _GREY)


def plane_figure(track: PlaneTrackArrays, surface_names: Sequence[str]) -> Figure:
    """Draw airspeed and energy on the left, angles of the flow and surfaces on the right, over time."""
    figure = Figure(figsize=(12.0, 6.0), layout="constrained")
    ((speed, flow), (energy, surfaces)) = figure.subplots(2, 2, sharex=True)
    t = track.t_s
    speed.plot(t, track.airspeed_mps, color=_BLUE, label="true airspeed")
    speed.axhline(track.stall_mps, color=_RED, lw=1.0, ls="--", label="stall, level")
    speed.set(title="Airspeed", ylabel="[m/s]")
    flow.plot(t, track.attack_deg, color=_BLUE, lw=1.0, label="angle of attack")
    flow.plot(t, track.sideslip_deg, color=_GREEN, lw=1.0, label="sideslip")
    flow.plot(t, track.bank_deg, color=_GREY, lw=0.9, label="bank")
    flow.set(title="Angles of the flow, and bank", ylabel="[deg]")
    energy.plot(t, track.energy_m, color=_BLUE, label="height + V²/2g")
    energy.plot(t, track.height_m, color=_GREY, label="height")
    energy.set(title="Energy as a height", ylabel="[m]", xlabel="simulated time [s]")
    for i, name in enumerate(surface_names):
        surfaces.plot(t, track.surface_deg[:, i], color=_SURFACES[i % len(_SURFACES)], lw=0.9, label=name)
    surfaces.set(title="Surfaces, trailing edge down positive", ylabel="[deg]", xlabel="simulated time [s]")
    for axes in (speed, flow, energy, surfaces):
        axes.grid(visible=True, alpha=0.3)
        legend(axes)
    return figure
