"""The report page of a run with several vehicles: their paths in one picture, and a row that links to each report.

matplotlib is slow to import: import this module at the end of a run, not at its start.
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.recorder.track import TrackArrays
from hil.run.report.html import text
from hil.run.report.page import Report, write_page
from hil.run_files import PAGE_NAME
from signals.errors import file_errors

PICTURE_NAME = "vehicles.png"
_MAX_NAMED = 12  # vehicles with a name in the picture's legend
_MAX_PAIRS = 200  # pairs whose distance is drawn


def write_group_report(out: Path, run: Mapping[str, Any], tracks: Mapping[str, TrackArrays]) -> None:
    """Write report.html and its picture. `run` is the content of run.json. Raises RecordingError."""
    from hil.run.report import figures

    with file_errors(out, "the report cannot be written"):
        with figures.style():
            picture = _draw(out / PICTURE_NAME, {name: track for name, track in tracks.items() if len(track.t_s)})
        caption = "paths of all vehicles, their heights, and the distances between them"
        report = Report([(caption, picture)], [("Vehicles", _vehicles_table(run["vehicles"]))])
        write_page(out, run, [], report, f"{len(run['vehicles'])} vehicles in {run['scene']}, seed {run['seed']}")


def _vehicles_table(vehicles: Mapping[str, Any]) -> str:
    head = ("vehicle", "result", "rig", "waypoints", "flown", "reasons")
    rows = []
    for name, run in vehicles.items():
        mission, error = run["mission"], run["error"]
        reasons = [error["message"]] if error else run["verdict"]["reasons"]
        cells = (
            run["status"] + (" (lost)" if run["lost"] else ""),
            run["rig"],
            f"{mission['reached']} of {mission['waypoints']}",
            text(run["sim_s"], "s"),
            "; ".join(reasons),
        )
        link = f"<a href='{escape(run['folder'])}/{PAGE_NAME}'>{escape(name)}</a>"
        rows.append(f"<tr><td>{link}</td>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return f"<table><tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr>{''.join(rows)}</table>"


def _draw(path: Path, tracks: Mapping[str, TrackArrays]) -> Path:
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5.2), layout="constrained")
    grid = figure.add_gridspec(2, 2)
    top, height, distance = (figure.add_subplot(spec) for spec in (grid[:, 0], grid[0, 1], grid[1, 1]))
    colours = colormaps["turbo"](np.linspace(0.05, 0.95, max(2, len(tracks))))
    for (name, track), colour in zip(tracks.items(), colours, strict=False):
        x, y, z = track.p_WB.T
        top.plot(x, y, color=colour, lw=1.2, label=name)
        top.plot(x[-1], y[-1], "o", color=colour, ms=4)
        height.plot(track.t_s, z, color=colour, lw=1.0)
    top.set(title="paths, seen from above", xlabel="east [m]", ylabel="north [m]", aspect="equal")
    height.set(title="height", xlabel="time [s]", ylabel="z [m]")
    if len(tracks) <= _MAX_NAMED:
        top.legend(loc="best")
    pairs = list(combinations(tracks.values(), 2))
    for a, b in pairs[:_MAX_PAIRS]:
        distance.plot(*_distances(a, b), color="#8a919b", lw=0.6)
    note = "" if len(pairs) <= _MAX_PAIRS else f" (of {_MAX_PAIRS} of {len(pairs)} pairs)"
    distance.set(title=f"distances between vehicles{note}", xlabel="time [s]", ylabel="m")
    distance.set_ylim(bottom=0.0)
    figure.savefig(path, dpi=130)
    return path


def _distances(a: TrackArrays, b: TrackArrays) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the times that both tracks have [s], and the distances then [m]. A longer track may have fewer of them."""
    t_s, of_a, of_b = np.intersect1d(a.t_s, b.t_s, assume_unique=True, return_indices=True)
    return t_s, np.linalg.norm(a.p_WB[of_a] - b.p_WB[of_b], axis=1)
