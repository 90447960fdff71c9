"""Outcome of a flight, and the report that goes to the bench with every frame."""

from __future__ import annotations

import math
from typing import Any

FLYING = "flying"
GOAL, STUCK, NO_PATH, GOAL_IN_OBSTACLE = "goal", "stuck", "no_path", "goal_in_obstacle"
LIDAR_LOST, IMU_LOST = "lidar_lost", "imu_lost"


class FlightReport:
    """Report of one flight, updated with every frame."""

    def __init__(self) -> None:
        self.phase = "climb"
        self.outcome = FLYING
        self.why = ""
        self.below = ""  # after an outcome, the surface below: ground, obstacle or unknown
        self.t_s = 0.0  # simulated time of the outcome
        self.goal_distance_m = math.inf  # by its own estimate
        self.sigma_m = 0.0
        self.replans = 0
        self.retreats = 0
        self.nearest_m = math.inf  # nearest obstacle of all sweeps, from the vehicle's centre
        self.plan_ms: list[float] = []  # wall-clock times are only reported, no decision depends on them
        self.update_ms: list[float] = []

    def as_map(self) -> dict[str, Any]:
        """Return the report as a flat map of texts and finite numbers."""
        entries: dict[str, Any] = {name: value for name, value in vars(self).items() if not isinstance(value, list)}
        entries["why"] = self.why[:200]
        if self.outcome != FLYING:
            entries.update(_quantiles("plan_ms", self.plan_ms))
            entries.update(_quantiles("update_ms", self.update_ms))
        return {key: value for key, value in entries.items() if not isinstance(value, float) or math.isfinite(value)}


def _quantiles(name: str, values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    ranked = sorted(values)
    return {f"{name}_p50": ranked[len(ranked) // 2], f"{name}_p95": ranked[int(0.95 * (len(ranked) - 1))]}
