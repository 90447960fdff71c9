"""Set-points of a followed flight, 50 a second from its beginning, complete: where the log commands nothing, the
trajectory that was measured is the set-point.

    position   of each axis the logged set-point, else the measured position
    velocity   the logged one; without it 0 beside a logged position, and the measured one beside a measured position;
               likewise the acceleration
    yaw        the logged set-point with its rate, else the measured heading with its rate

All are rounded, positions to 0.1 mm: they feed state, and the last bits of libraries' sines and
sums differ between processors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.set_points import commanded_at, unwrapped_at
from signals.rotation import yaw_of

Rows = NDArray[np.float64]

RATE_HZ = 50
_DIGITS = 4
_SMOOTH_S = 0.2  # over which a measured position becomes a velocity, a velocity an acceleration, a heading a rate


@dataclass(frozen=True)
class Course:
    """Set-points in W; `t_s` from 0. `topic` is their name in the log, empty where it has none.

    `measured`: share of the numbers of position and of yaw for which the measured trajectory stands in.
    """

    t_s: Rows
    p_W: Rows
    v_W: Rows
    a_W: Rows
    yaw_rad: Rows
    yaw_rate_radps: Rows
    topic: str
    measured: dict[str, float]
    as_asked: bool = False  # the measured trajectory is followed whatever the log commands

    @property
    def words(self) -> str:
        """Origin of the set-points, for people."""
        if self.as_asked:
            return "the measured trajectory itself is followed, as asked"
        if not self.topic or self.measured["position"] >= 1.0:
            return "the log has no set-points: the measured trajectory itself is followed"
        text = f"set-points of {self.topic}"
        shares = [f"{share:.0%} of the {what}" for what, share in self.measured.items() if share > 0.0]
        return text + (f"; measured where it has none: {', '.join(shares)}" if shares else "")


def course_of(log: FlightLog, begin_s: float, end_s: float, shift_m: Rows, *, measured: bool) -> Course:
    """Return the course of a flight whose log has a pose. `measured`: whatever the log commands."""
    assert log.pose is not None
    t_s = np.arange(int((end_s - begin_s) * RATE_HZ) + 1) / RATE_HZ
    at_s = begin_s + t_s
    pose = pose_at(log.pose, at_s)
    p_measured = pose[:, :3]
    v_measured = measured_velocity(log, at_s)
    half_s = 0.5 * _SMOOTH_S
    a_measured = (measured_velocity(log, at_s + half_s) - measured_velocity(log, at_s - half_s)) / _SMOOTH_S
    headings = np.array([yaw_of(tuple(q)) for q in pose[:, 3:].tolist()], np.float64)
    yaw_measured = np.unwrap(headings)
    points = None if measured else log.set_points
    if points is None:
        p = v = a = np.full_like(p_measured, np.nan)
        yaw = yaw_rate = np.full_like(yaw_measured, np.nan)
    else:
        p = commanded_at(at_s, points.t_s, points.p_W)
        v = commanded_at(at_s, points.t_s, points.v_W)
        a = commanded_at(at_s, points.t_s, points.a_W)
        yaw = unwrapped_at(at_s, points.t_s, points.yaw_rad)
        yaw_rate = commanded_at(at_s, points.t_s, points.yaw_rate_radps[:, None])[:, 0]
    no_place, no_yaw = np.isnan(p), np.isnan(yaw)
    v = np.where(np.isnan(v), np.where(no_place, v_measured, 0.0), v)
    a = np.where(np.isnan(a), np.where(no_place, a_measured, 0.0), a)
    steps = round(half_s * RATE_HZ)
    turned = np.pad(yaw_measured, steps, "edge")
    rate = (turned[2 * steps :] - turned[: len(yaw)]) / _SMOOTH_S
    return Course(
        t_s=t_s,
        p_W=_rounded(np.where(no_place, p_measured, p) + shift_m),
        v_W=_rounded(v),
        a_W=_rounded(a),
        yaw_rad=_rounded(np.where(no_yaw, yaw_measured, yaw)),
        yaw_rate_radps=_rounded(np.where(no_yaw, rate, np.nan_to_num(yaw_rate))),
        topic="" if points is None else points.topic,
        measured={"position": float(no_place.mean()), "yaw": float(no_yaw.mean())},
        as_asked=measured,
    )


def sampled(series: Series, at_s: Rows) -> Rows:
    """Return the values of a series at these times, linear."""
    return np.stack([np.interp(at_s, series.t_s, column) for column in series.values.T], axis=1)


def pose_at(pose: Series, at_s: Rows) -> Rows:
    """Return positions and unit quaternions, whose signs have no jumps, at these times; linear."""
    values = sampled(pose, at_s)
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return values


def measured_velocity(log: FlightLog, at_s: Rows) -> Rows:
    """Return the logged velocity, else that of the positions over `_SMOOTH_S`."""
    if log.velocity is not None and len(log.velocity):
        return sampled(log.velocity, at_s)
    assert log.pose is not None
    half_s = 0.5 * _SMOOTH_S
    return (sampled(log.pose, at_s + half_s)[:, :3] - sampled(log.pose, at_s - half_s)[:, :3]) / _SMOOTH_S


def _rounded(values: Rows) -> Rows:
    return np.asarray(np.round(values, _DIGITS), np.float64)
