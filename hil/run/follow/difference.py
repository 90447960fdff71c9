"""Differences between a simulated flight and the real one that it follows.

At each instant t of the followed time, with the real flight taken at the same time of its own clock:

    position   |p_sim - p_real|        velocity   |v_sim - v_real|        rate   |w_sim - w_real|
    attitude   2 acos |q_sim . q_real|, the angle of the rotation between the two
    delay      the time by which the simulated flight is later: that of the least rms of p_sim(t + d) - p_real(t)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

_MOST_DELAY_S = 2.0


@dataclass(frozen=True)
class Motion:
    """Rows of one flight [n, ...]; `w_WB_B` is NaN where no gyro was logged."""

    p_WB: Rows
    q_WB: Rows
    v_WB_W: Rows
    w_WB_B: Rows


@dataclass(frozen=True)
class Differences:
    """Differences at each instant [n]. `by_axis_m`: p_sim - p_real, east, north, up [n, 3]."""

    t_s: Rows
    by_axis_m: Rows
    position_m: Rows
    velocity_mps: Rows
    attitude_deg: Rows
    rate_radps: Rows


def differences(t_s: Rows, simulated: Motion, real: Motion) -> Differences:
    """Return the differences of two flights at the same instants."""
    apart = simulated.p_WB - real.p_WB
    dot = np.clip(np.abs(np.einsum("ij,ij->i", simulated.q_WB, real.q_WB)), 0.0, 1.0)
    return Differences(
        t_s=t_s,
        by_axis_m=apart,
        position_m=np.linalg.norm(apart, axis=1),
        velocity_mps=np.linalg.norm(simulated.v_WB_W - real.v_WB_W, axis=1),
        attitude_deg=np.degrees(2.0 * np.arccos(dot)),
        rate_radps=np.linalg.norm(simulated.w_WB_B - real.w_WB_B, axis=1),
    )


def rms(values: Rows) -> float | None:
    """Return the root of the mean square of the numbers; None without one."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite * finite))) if len(finite) else None


def greatest(values: Rows) -> float | None:
    """Return the greatest of the numbers; None without one."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else None


def delay_s(t_s: Rows, simulated_p: Rows, real_p: Rows) -> float | None:
    """Return by how much the simulated flight is later, to one step of `t_s`; None for less than 4 s of flight.

    Compared is the time for which all shifts have both flights, so that each shift has the same rows.
    """
    if len(t_s) < 2:
        return None
    step_s = float(np.median(np.diff(t_s)))
    most = round(_MOST_DELAY_S / step_s)
    if len(t_s) < 2 * most + 2:
        return None
    middle = real_p[most:-most]
    errors = [
        float(np.mean((simulated_p[most + k : len(t_s) - most + k] - middle) ** 2)) for k in range(-most, most + 1)
    ]
    return (int(np.argmin(errors)) - most) * step_s
