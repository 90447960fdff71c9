"""A log as a table with a map of its columns: a vehicle that rises, flies a given way, comes back down and stands.

t          0 to 3 s      3 to 3 + T                 then           to the end
motors     0             hover                      hover          0
place      ground        ground + way(t - 3)        ground         ground
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STAND_S = 3.0
HOVER = 0.78  # command of an x500
GROUND = np.array([100.0, -50.0, 7.0])  # of the log's own frame
HEADER = [*"t m1 m2 m3 m4 x y z qw qx qy qz sx sy sz syaw svx svy svz".split()]  # noqa: SIM905
MAP = """
time: {column: t, unit: s}
world: enu
body: flu
estimated: false
motors: {columns: [m1, m2, m3, m4], kind: command, range: [0, 1]}
position: {columns: [x, y, z], unit: m}
attitude: {quaternion: [qw, qx, qy, qz]}
"""
SET_POINTS = """
set_points:
  position: {columns: [sx, sy, sz], unit: m}
  yaw: {column: syaw, unit: rad}
"""
VELOCITY = "  velocity: {columns: [svx, svy, svz], unit: m/s}\n"


def write_log(
    folder: Path,
    way: Callable[[Array], Array],
    duration_s: float,
    *,
    measured_m: Array | None = None,
    heading_rad: float = 0.4,
    set_points: bool = True,
    velocities: bool = False,
    change: Callable[[Array], Array] | None = None,
) -> tuple[Path, Path]:
    """Write flight.csv and flight.yaml. `way(s)` [n, 3]: from the ground, at s = 0, to the ground, at `duration_s`.

    The measured place is `measured_m` off the set-point from the time at which it is half a metre high. `velocities`:
    the set-points have the way's velocity, too. `change` gets and returns all columns, NaN for an empty cell.
    """
    t = np.arange(0.0, duration_s + 2.0 * STAND_S, 0.02)
    s = np.clip(t - STAND_S, 0.0, duration_s)
    told = GROUND + way(s)
    high = (told[:, 2] > GROUND[2] + 0.5)[:, None]
    place = told + np.where(high, np.zeros(3) if measured_m is None else measured_m, 0.0)
    flying = (t >= STAND_S) & (t <= STAND_S + duration_s)
    columns = np.zeros((len(t), len(HEADER)))
    columns[:, 0] = t
    columns[:, 1:5] = np.where(flying, HOVER, 0.0)[:, None]
    columns[:, 5:8] = place
    columns[:, 8], columns[:, 11] = np.cos(0.5 * heading_rad), np.sin(0.5 * heading_rad)
    columns[:, 12:15] = told
    columns[:, 15] = heading_rad
    columns[:, 16:] = np.gradient(told, t, axis=0)
    if change is not None:
        columns = change(columns)
    log, columns_map = folder / "flight.csv", folder / "flight.yaml"
    rows = [",".join("" if np.isnan(cell) else f"{cell:.6f}" for cell in row) for row in columns.tolist()]
    log.write_text("\n".join([",".join(HEADER), *rows]) + "\n")
    columns_map.write_text(MAP + (SET_POINTS if set_points else "") + (VELOCITY if velocities else ""))
    return log, columns_map


def line(height_m: float, length_m: float, duration_s: float) -> Callable[[Array], Array]:
    """Return a way straight up, east and down: 5 s up, 3 s still, then the line, 3 s still, and 10 s down."""

    def way(s: Array) -> Array:
        from_s, to_s = 8.0, duration_s - 13.0
        up = np.minimum(np.clip(s / 5.0, 0.0, 1.0), np.clip((duration_s - s) / 10.0, 0.0, 1.0))
        along = np.clip((s - from_s) / (to_s - from_s), 0.0, 1.0)
        along = along * along * (3.0 - 2.0 * along)
        return np.stack([length_m * along, np.zeros_like(s), height_m * up], axis=1)

    return way
