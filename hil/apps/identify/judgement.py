"""Judgement of a fit: does the fitted vehicle predict held-out flight better than the one it began with?

    ratio = exp(mean over logs, horizons and quantities of log(after / before))

The geometric mean counts metres and radians alike. Above 1, the fit made the vehicle worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.apps.identify.fit_result import Fit, Prediction

QUANTITIES = {
    "position_m": ("position", "m"),
    "velocity_mps": ("velocity", "m/s"),
    "rotation_rad": ("rotation", "rad"),
    "rate_radps": ("rate", "rad/s"),
}


def judged_pairs(fit: Fit, horizons_s: Sequence[float] = ()) -> list[tuple[Prediction, Prediction]]:
    """Return predictions before and after; with `horizons_s` only those of the nearest horizons that the fit has."""
    pairs = list(zip(fit.before, fit.after, strict=True))
    there = sorted({before.horizon_s for before, _ in pairs})
    if not horizons_s or not there:
        return pairs
    chosen = {min(there, key=lambda h: abs(math.log(h / wanted))) for wanted in horizons_s}
    return [pair for pair in pairs if pair[0].horizon_s in chosen]


def error_ratio(pairs: Sequence[tuple[Prediction, Prediction]]) -> float:
    """Return the geometric mean of the errors after over before; infinite if one after is, NaN without any before."""
    logs = []
    for before, after in pairs:
        for name in QUANTITIES:
            was, now = float(getattr(before, name)), float(getattr(after, name))
            if math.isnan(was):
                continue
            if not math.isfinite(now):
                return math.inf
            if was == math.inf:  # no number is as much better
                continue
            logs.append(math.log(max(now, 1e-12) / max(was, 1e-12)))
    return math.exp(sum(logs) / len(logs)) if logs else math.nan


def mean_by_horizon(predictions: Sequence[Prediction]) -> list[Prediction]:
    """Return the means over the logs at each horizon, NaN left out."""
    found = []
    for horizon_s in sorted({p.horizon_s for p in predictions}):
        at = [p for p in predictions if p.horizon_s == horizon_s]
        values = {}
        for name in QUANTITIES:
            numbers = [float(getattr(p, name)) for p in at if not math.isnan(getattr(p, name))]
            values[name] = sum(numbers) / len(numbers) if numbers else math.nan
        found.append(Prediction("all", horizon_s, **values))
    return found
