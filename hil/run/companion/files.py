"""Files of a run with companions, the trace and the timings, readable without loading ZeroMQ."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

COLUMNS = (
    *("client", "frame", "tick", "t_ns", "render_ns", "link_ns", "t1_ns"),
    *("t2_ns", "reply_ns", "command_ns", "t3_ns", "clock_offset_ns"),
)


class FrameTimes(NamedTuple):
    """Timings of one client, an element per frame; NaN if unknown."""

    t_s: NDArray[np.float64]  # simulated time of the frame
    render_ms: NDArray[np.float64]
    link_ms: NDArray[np.float64]
    t1_ms: NDArray[np.float64]
    t2_ms: NDArray[np.float64]
    t3_ms: NDArray[np.float64]


def read_timing(path: Path) -> dict[str, FrameTimes]:
    """Return the timings by client in the order of the frames, empty without a file. Skips a truncated last row."""
    if not path.is_file():
        return {}
    columns = ("t_ns", "render_ns", "link_ns", "t1_ns", "t2_ns", "t3_ns")
    rows: dict[str, list[tuple[float, ...]]] = {}
    complete = path.read_text(encoding="utf-8").rpartition("\n")[0]
    for row in csv.DictReader(complete.splitlines()):
        rows.setdefault(row["client"], []).append(tuple(float(row[c] or "nan") for c in columns))
    scale = np.array([1e-9, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6])
    return {name: FrameTimes(*(np.array(sorted(times)) * scale).T) for name, times in sorted(rows.items())}
