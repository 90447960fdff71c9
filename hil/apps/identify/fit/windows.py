"""Logs cut into short windows on a grid: what the motors did, and which reading of a sensor belongs to which instant.

Every sensor reading is used at most once, in the step that it lies in and at its own time; nothing measured is
interpolated, because the slope of a noisy series would pull a delay towards half a sample. Only motors are
interpolated: logged speeds as smoothed cubic splines, commands as the mean of what was held during a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from hil.apps.identify.fit.flight_model import ACCEL, ATTITUDE, OUTPUTS, POSITION, RATE, SERIES, VELOCITY
from hil.apps.identify.fit.motor_telemetry import smoothed
from hil.run.flight_logs.flight_log import FlightLog, Series

Array = NDArray[np.float64]
_EARLY = 0.01


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


def within_steps(t_s: Array, grid_s: Array, step_s: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the index of the first reading in the step from each instant, and which steps have one.

    Stamps are rounded to microseconds: a reading may lie `_EARLY` steps before its instant.
    """
    from_s = grid_s - _EARLY * step_s
    index = np.minimum(np.searchsorted(t_s, from_s), len(t_s) - 1)
    return index, (t_s[index] >= from_s) & (t_s[index] < from_s + step_s)


@dataclass
class Windows:
    """Windows of one log on a grid of the motors' clock: `starts` [W] and `steps` each, `step_s` long."""

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

    def inputs(self) -> Array:
        """[steps, inputs, W] of the model."""
        t = self.instants()
        flat = self.motors.inputs(t.ravel(), self.step_s)
        volts = np.ones(t.size)
        if self.log.voltage is not None:
            volts = np.interp(t.ravel(), self.log.voltage.t_s, self.log.voltage.values[:, 0]) / self.nominal_v
        flat = np.vstack([flat, volts, np.full(t.size, self.log.ground_or_far_below_m)])
        return flat.reshape(len(flat), *t.shape).transpose(1, 0, 2)

    def readings(self, motor_delay_s: float, pose_delay_s: float) -> tuple[Array, Array, Array]:
        """Return y [steps, OUTPUTS, W] with NaN where nothing was read, q_measured [steps, 4, W], and the readings'
        shares of their steps [steps, SERIES, W]. A reading of the clock of the gyro is `motor_delay_s` later here.

        The rotation vector's reading is 0 where the attitude was measured.
        """
        grid_s = self.instants()
        flat = grid_s.ravel()
        y, q, share = np.full((OUTPUTS, flat.size), np.nan), np.zeros((4, flat.size)), np.zeros((SERIES, flat.size))
        q[0] = 1.0
        log, late_s = self.log, (-motor_delay_s, pose_delay_s - motor_delay_s)
        pose = None if log.pose is None else Series(log.pose.t_s, log.pose.values[:, :3])
        sensors = (
            (log.rate, RATE, late_s[0]),
            (log.accel, ACCEL, late_s[0]),
            (pose, POSITION, late_s[1]),
            (log.velocity, VELOCITY, late_s[1]),
        )
        for row, (series, outputs, delay_s) in enumerate(sensors):
            if series is None:
                continue
            t_s = series.t_s - delay_s
            i, known = within_steps(t_s, flat, self.step_s)
            i = i[known]
            y[outputs, known] = series.values[i].T
            share[row, known] = (t_s[i] - flat[known]) / self.step_s
            if outputs == POSITION and log.pose is not None:
                y[ATTITUDE, known] = 0.0
                q[:, known] = log.pose.values[i, 3:7].T
        y, q, share = (x.reshape(-1, *grid_s.shape).transpose(1, 0, 2) for x in (y, q, share))
        return y, q, share
