"""What the explorer knows and wants, for people who look on while it flies."""

from __future__ import annotations

import math

import numpy as np

from hil_companion.explore.explorer import Explorer
from hil_companion.view import FREE, NEAR, OCCUPIED, UNKNOWN, Grid, View


def overview(explorer: Explorer) -> View | None:
    """Of the moment; None before there is a position to show."""
    estimate = explorer.estimate
    if estimate is None or not all(math.isfinite(float(v)) for v in (*estimate.p_W, estimate.yaw_rad)):
        return None
    particles = getattr(estimate, "particles_xy", None)
    return View(
        p_W=[float(v) for v in estimate.p_W],
        yaw_rad=float(estimate.yaw_rad),
        goal_W=explorer.goal_W,
        plan_W=np.asarray(explorer.route.points_W, float).reshape(-1, 2) if explorer.route.found else None,
        particles_W=None if particles is None else particles[np.isfinite(particles).all(axis=1)],
        grid=_grid(explorer),
    )


def _grid(explorer: Explorer) -> Grid | None:
    around = explorer.map
    if around is None:
        return None
    settings = explorer.settings
    cells = np.full(around.distance_m.shape, FREE, np.uint8)
    cells[around.distance_m < settings.vehicle_radius_m + settings.clearance_m] = NEAR
    cells[around.unknown] = UNKNOWN
    cells[around.distance_m <= 0.0] = OCCUPIED
    return Grid(cells, around.origin_W, around.cell_m)
