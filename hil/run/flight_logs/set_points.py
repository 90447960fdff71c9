"""Set-points of a flight as its log has them: what its position controller was told to follow.

A number that was not commanded is NaN: PX4 commands a velocity alone while a stick is held, and older logs have no
velocities. Between two samples a set-point is linear; where samples are missing it is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.ned import enu_from_ned

Rows = NDArray[np.float64]

GAP_S = 1.0  # without a sample: nothing was commanded. Autopilots log set-points at 5 to 50 Hz


@dataclass(frozen=True)
class SetPoints:
    """Set-points over the log's own clock, increasing strictly; NaN: not commanded.

    `p_W` [n, 3] in m, `v_W` in m/s and `a_W` in m/s2, which are fed forward beside a position, `yaw_rad` [n] from
    east, counter-clockwise, and `yaw_rate_radps` [n], fed forward beside it. `topic`: their name in the log.
    """

    topic: str
    t_s: Rows
    p_W: Rows
    v_W: Rows
    a_W: Rows
    yaw_rad: Rows
    yaw_rate_radps: Rows


@dataclass(frozen=True)
class Columns:
    """Set-points as a log has them, in ENU or, with the yaw from north, clockwise, in NED. NaN: not commanded."""

    t_s: Rows
    p: Rows  # [n, 3]
    v: Rows
    a: Rows
    yaw_rad: Rows  # [n]
    yaw_rate_radps: Rows


def set_points_of(topic: str, columns: Columns, *, ned: bool) -> SetPoints | None:
    """Return the rows that command a place or a velocity, in the order of their times; None if there is none."""
    c = columns
    t_s = np.asarray(c.t_s, np.float64)
    commanded = np.isfinite(t_s) & (np.isfinite(c.p).any(axis=1) | np.isfinite(c.v).any(axis=1))
    if not commanded.any():
        return None
    t_s, first = np.unique(t_s[commanded], return_index=True)
    rows = np.flatnonzero(commanded)[first]
    p, v, a, yaw, rate = (
        np.where(np.isfinite(values[rows]), values[rows], np.nan)
        for values in (c.p, c.v, c.a, c.yaw_rad, c.yaw_rate_radps)
    )
    if ned:
        p, v, a, yaw, rate = enu_from_ned(p), enu_from_ned(v), enu_from_ned(a), 0.5 * np.pi - yaw, -rate
    return SetPoints(topic, t_s, p, v, a, yaw, rate)


def commanded_at(t_s: Rows, at_s: Rows, values: Rows) -> Rows:
    """Return values [n, m] of the times `at_s`, linear, at `t_s`; NaN beside a NaN or a gap of more than `GAP_S`."""
    found = np.full((len(t_s), values.shape[1]), np.nan)
    if not len(at_s):
        return found
    right = np.clip(np.searchsorted(at_s, t_s, "left"), 0, len(at_s) - 1)
    left = np.clip(right - 1, 0, None)
    # Before the first and after the last sample: that one, for the time of a gap.
    left = np.where((t_s > at_s[-1]) | (t_s == at_s[right]), right, left)
    right = np.where(t_s <= at_s[0], 0, right)
    step = at_s[right] - at_s[left]
    share = np.where(step > 0.0, (t_s - at_s[left]) / np.where(step > 0.0, step, 1.0), 1.0)
    share = np.clip(share, 0.0, 1.0)[:, None]
    mixed = values[left] + share * (values[right] - values[left])
    outside = np.maximum(at_s[left] - t_s, t_s - at_s[right])
    known = (step <= GAP_S) & (outside <= GAP_S)
    found[known] = mixed[known]
    return found


def unwrapped_at(t_s: Rows, at_s: Rows, angle_rad: Rows) -> Rows:
    """Return an angle as `commanded_at`, along the shorter way round between two samples."""
    known = np.isfinite(angle_rad)
    if not known.any():
        return np.full(len(t_s), np.nan)
    return commanded_at(t_s, at_s[known], np.unwrap(angle_rad[known])[:, None])[:, 0]
