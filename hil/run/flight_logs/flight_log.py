"""A flight as every reader of a log returns it and the estimator takes it.

Frames W (ENU) and B (FLU, origin at the vehicle file's), SI units, quaternions w-x-y-z that rotate B into W. Every
series keeps the times at which its sensor or autopilot took the values, on one clock of the log: nothing is resampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.set_points import SetPoints

_FAR_BELOW_M = -1e4
MotorsKind = Literal["speed_radps", "command"]


@dataclass(frozen=True)
class Series:
    """Values over time: `t_s` float64 [n], strictly increasing, on the log's own clock; `values` float64 [n, m].

    Every value is finite. Raises ValueError otherwise.
    """

    t_s: NDArray[np.float64]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.t_s.dtype != np.float64 or self.values.dtype != np.float64:
            raise ValueError(f"times and values must be float64, not {self.t_s.dtype} and {self.values.dtype}")
        if self.t_s.ndim != 1 or self.values.ndim != 2 or len(self.t_s) != len(self.values):
            raise ValueError(f"times {self.t_s.shape} and values {self.values.shape} must be [n] and [n, m]")
        if not (np.isfinite(self.t_s).all() and np.isfinite(self.values).all()):
            raise ValueError("times and values must be finite")
        if not (np.diff(self.t_s) > 0.0).all():
            raise ValueError("times must increase strictly")

    def __len__(self) -> int:
        return len(self.t_s)

    def between(self, start_s: float, end_s: float) -> Series:
        """Return the samples with start_s <= t <= end_s, as views."""
        first, last = np.searchsorted(self.t_s, start_s, "left"), np.searchsorted(self.t_s, end_s, "right")
        return Series(self.t_s[first:last], self.values[first:last])


@dataclass(frozen=True)
class FlightLog:
    """One stretch of flight from a log, or a whole log before it is split; from `start_s` to `end_s` of its clock.

    `motors` are in the order of the vehicle file's rotors: speeds in rad/s, or commands from 0 to 1. `pose` is p_WB in
    m and q_WB (7 columns), `velocity` v_WB_W in m/s, `rate` the gyro's w_WB_B in rad/s, `accel` the specific force in
    m/s2 in B, `voltage` the battery's in V (1 column). `set_points` are what the controller followed, `wind` the
    estimated velocity of the air, east and north, in m/s. None stands for a series that the log does not have.
    """

    name: str
    source: Path
    motors: Series
    motors_kind: MotorsKind
    pose: Series | None
    velocity: Series | None
    rate: Series | None
    accel: Series | None
    voltage: Series | None
    estimated: bool  # pose and velocity are an autopilot's estimate, not motion capture
    start_s: float
    end_s: float
    set_points: SetPoints | None = None  # of the whole log, whatever stretch this is
    wind: Series | None = None  # likewise
    ground_m: float | None = None  # height of the ground in W, where the log shows it

    @property
    def ground_or_far_below_m(self) -> float:
        """Height of the ground, out of every rotor's reach where it is not known."""
        return _FAR_BELOW_M if self.ground_m is None else self.ground_m

    @property
    def duration_s(self) -> float:
        return self.end_s - self.start_s

    def between(self, start_s: float, end_s: float, name: str) -> FlightLog:
        """Return the stretch from `start_s` to `end_s` under a name of its own. Its series are views of these.

        A series of which less than two values lie in it is one that the stretch does not have.
        """

        def cut(series: Series | None) -> Series | None:
            part = None if series is None else series.between(start_s, end_s)
            return part if part is not None and len(part) > 1 else None

        return replace(
            self,
            name=name,
            motors=self.motors.between(start_s, end_s),
            pose=cut(self.pose),
            velocity=cut(self.velocity),
            rate=cut(self.rate),
            accel=cut(self.accel),
            voltage=cut(self.voltage),
            start_s=start_s,
            end_s=end_s,
        )
