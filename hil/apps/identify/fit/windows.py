"""Logs cut into short windows on a grid: what the motors did, and which reading of a sensor belongs to which instant.

Every sensor reading is used at most once, at the nearest instant of the grid and at its own time; nothing measured is
interpolated, because the slope of a noisy series would pull a delay towards half a sample. Only motors are
interpolated: logged speeds as smoothed cubic splines, commands as the mean of what was held during a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from hil.apps.identify.fit.flight_model import OUTPUTS
from hil.apps.identify.fit.motor_telemetry import smoothed
from hil.run.flight_logs.flight_log import FlightLog, Series

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motors:
    """Motor signals of a log as functions of time: value, slope and curvature of each."""

    kind: str
    spline: Any
    t_s: Array
    held: Array
    integral: Array
    moment: Array

    @staticmethod
    def of(log: FlightLog, *, lag: int | None = None) -> Motors:
        """With `lag`, a value at a sample's time is made of telemetry up to so many samples later, and of no more."""
        t, x = log.motors.t_s, log.motors.values
        if log.motors_kind == "speed_radps":
            return Motors("speed_radps", CubicHermiteSpline(t, *smoothed(log.motors, lag=lag)), t, x, x, x)
        steps = np.diff(t)[:, None] * x[:-1]
        moments = (0.5 * (t[1:] + t[:-1]) - t[0])[:, None] * steps
        zero = np.zeros(x.shape[1])
        return Motors("command", None, t, x, *(np.vstack([zero, np.cumsum(y, axis=0)]) for y in (steps, moments)))

    def inputs(self, t_s: Array, step_s: float, *, latest_s: Array | float = np.inf) -> Array:
        """Return [9 rotors, instants]: for start, middle and end of the step from each instant signal, slope, bend.

        Speeds after `latest_s` are those of that time: what came later was not known.
        """
        if self.kind == "speed_radps":
            parts = []
            for part in (0.0, 0.5, 1.0):
                at = np.clip(np.minimum(t_s + part * step_s, latest_s), self.t_s[0], self.t_s[-1])
                parts += [self.spline(at).T, self.spline(at, 1).T, self.spline(at, 2).T]
            return np.concatenate(parts)
        # Held commands, over a step: the straight line with their mean and first moment, about its middle.
        h, a, b = step_s, t_s, t_s + step_s
        first, last = self._held(a), self._held(b)
        mean = (self._integral(b) - self._integral(a)) / h
        middle = (0.5 * (a + b) - self.t_s[0])[:, None]
        lean = 12.0 * (self._moment(b) - self._moment(a) - middle * h * mean) / h**3
        mean_by_delay = (last - first) / h
        lean_by_delay = 12.0 * (0.5 * h * (first + last) - h * mean) / h**3
        parts = []
        for part in (-0.5, 0.0, 0.5):
            value, slope = mean + part * h * lean, mean_by_delay + part * h * lean_by_delay
            parts += [value.T, slope.T, np.zeros_like(mean).T]
        return np.concatenate(parts)

    def _held(self, t_s: Array) -> Array:
        return self.held[np.clip(np.searchsorted(self.t_s, t_s, "right") - 1, 0, len(self.t_s) - 1)]

    def _integral(self, t_s: Array) -> Array:
        i = np.clip(np.searchsorted(self.t_s, t_s, "right") - 1, 0, len(self.t_s) - 1)
        return self.integral[i] + (t_s - self.t_s[i])[:, None] * self.held[i]

    def _moment(self, t_s: Array) -> Array:
        """Integral of (t - first time) u."""
        i = np.clip(np.searchsorted(self.t_s, t_s, "right") - 1, 0, len(self.t_s) - 1)
        between = 0.5 * (t_s + self.t_s[i]) - self.t_s[0]
        return self.moment[i] + (between * (t_s - self.t_s[i]))[:, None] * self.held[i]


@dataclass
class Readings:
    """One series on a grid: index of the reading of each instant, or -1, and its own time."""

    index: NDArray[np.int64]
    series: Series

    @property
    def known(self) -> NDArray[np.bool_]:
        return self.index >= 0


def nearest(series: Series | None, grid_s: Array, step_s: float, delay_s: float) -> Readings | None:
    """Return which reading, moved back by its delay, is nearest to each instant and within half a step of it."""
    if series is None:
        return None
    t = series.t_s - delay_s
    right = np.clip(np.searchsorted(t, grid_s), 0, len(t) - 1)
    left = np.maximum(right - 1, 0)
    best = np.where(np.abs(t[left] - grid_s) < np.abs(t[right] - grid_s), left, right)
    near = np.abs(t[best] - grid_s) <= 0.5 * step_s * (1 + 1e-9)
    index = np.where(near, best, -1)
    again = np.flatnonzero((index[1:] == index[:-1]) & (index[1:] >= 0)) + 1
    index[again] = -1
    return Readings(index, series)


@dataclass
class Windows:
    """Windows of one log on its grid: `starts` [W] and `steps` instants each, `step_s` apart."""

    log: FlightLog
    number: int  # of the log
    starts_s: Array
    steps: int
    step_s: float
    motors: Motors
    nominal_v: float

    @property
    def count(self) -> int:
        return len(self.starts_s)

    def instants(self) -> Array:
        """[steps, W]"""
        return np.arange(self.steps)[:, None] * self.step_s + self.starts_s[None, :]

    def inputs(self, motor_delay_s: float) -> Array:
        """[steps, inputs, W] of the model at the given delay of the motors."""
        t = self.instants()
        flat = self.motors.inputs(t.ravel() + motor_delay_s, self.step_s)
        volts = np.ones(t.size)
        if self.log.voltage is not None:
            volts = np.interp(t.ravel(), self.log.voltage.t_s, self.log.voltage.values[:, 0]) / self.nominal_v
        flat = np.vstack([flat, volts, np.full(t.size, self.log.ground_or_far_below_m)])
        return flat.reshape(len(flat), *t.shape).transpose(1, 0, 2)

    def readings(self, pose_delay_s: float) -> tuple[Array, Array, Array]:
        """Return y [steps, OUTPUTS, W] with NaN where nothing was read, q_measured [steps, 4, W], and dt [steps, 3, W].

        The rotation vector's reading is 0 where the attitude was measured.
        """
        t = self.instants()
        y = np.full((OUTPUTS, t.size), np.nan)
        q = np.zeros((4, t.size))
        q[0] = 1.0
        dt = np.zeros((3, t.size))
        flat = t.ravel()
        for row, series in ((0, self.log.rate), (1, self.log.accel)):
            if (found := nearest(series, flat, self.step_s, 0.0)) is not None:
                known, i = found.known, found.index
                y[3 * row : 3 * row + 3, known] = found.series.values[i[known]].T
                dt[row, known] = found.series.t_s[i[known]] - flat[known]
        for rows, series in ((slice(6, 9), self.log.pose), (slice(12, 15), self.log.velocity)):
            if (found := nearest(series, flat, self.step_s, pose_delay_s)) is None:
                continue
            known, i = found.known, found.index
            y[rows, known] = found.series.values[i[known], :3].T
            dt[2, known] = found.series.t_s[i[known]] - pose_delay_s - flat[known]
            if series is self.log.pose:
                y[9:12, known] = 0.0
                q[:, known] = found.series.values[i[known], 3:7].T
        shape = (-1, *t.shape)
        y, q, dt = (x.reshape(shape).transpose(1, 0, 2) for x in (y, q, dt))
        return y, q, dt
