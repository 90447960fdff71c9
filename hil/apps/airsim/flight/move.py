"""Interface of AirSim's moves: state machines that return a command every 20 ms of simulated time.

Everything here is in AirSim's frames: NED from the place where the vehicle started, body FRD. `flight.ned_edge` turns
it into the bench's frames.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple, Protocol

from signals.rotation import yaw_of
from signals.samples import Quat, Vec3
from signals.time import NS_PER_MS, NS_PER_S

PERIOD_NS = 20 * NS_PER_MS  # AirSim's command period
PERIOD_S = PERIOD_NS / NS_PER_S
ACCURACY_M = 0.5  # AirSim's distance accuracy of simple_flight: a place nearer than this is reached
Xy = tuple[float, float]


class MoveError(ValueError):
    """Argument of a move that cannot be flown, or a state in which the move cannot begin."""


class NedState(NamedTuple):
    """State of the vehicle as AirSim describes it."""

    t_ns: int
    p_m: Vec3  # from the vehicle's start
    v_mps: Vec3  # in NED
    q: Quat  # w-x-y-z, FRD -> NED
    w_radps: Vec3  # in FRD
    in_contact: bool
    landed: bool  # on the ground with idle rotors

    @property
    def yaw_rad(self) -> float:
        """Heading from north, clockwise."""
        return yaw_of(self.q)


class Command(NamedTuple):
    """Command for the controller: one horizontal, one vertical and one heading value, or `pwms` alone."""

    p_xy_m: Xy | None = None
    v_xy_mps: Xy | None = None
    roll_pitch_rad: Xy | None = None  # FRD: positive pitch is nose up
    roll_pitch_rate_radps: Xy | None = None
    z_m: float | None = None
    vz_mps: float | None = None
    throttle: float | None = None  # 0..1 as AirSim's quadrotor takes it: 0.5866 hovers
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None
    speed_limit_mps: float | None = None  # of the way to a position
    pwms: tuple[float, ...] | None = None  # front right, rear left, front left, rear right


NOTHING = Command()  # sends nothing: the last command goes on, until the vehicle hovers


class Move(Protocol):
    """Move that `SimpleFlight.start` runs. It begins with the first step."""

    succeeded: bool  # AirSim's return value, valid once `step` has returned None

    def step(self, state: NedState) -> Command | None:
        """Return the command of the next 20 ms; None: the move is over. Raises MoveError."""
        ...


class Clock:
    """Time since the first step of a move, and its end after `limit_s`."""

    def __init__(self, limit_s: float) -> None:
        # A client's single-precision 0.1 is 0.100000001: it ends with the fifth period, not the sixth.
        self._limit_ns = limit_s * NS_PER_S * (1.0 - 1e-6)
        self._start_ns: int | None = None

    def over(self, t_ns: int) -> bool:
        """Start at the first call; return True once the limit is reached."""
        if self._start_ns is None:
            self._start_ns = t_ns
        return t_ns - self._start_ns >= self._limit_ns


def finite(**values: float) -> None:
    """Raise MoveError for the first value that is NaN or infinite."""
    for name, value in values.items():
        if not isfinite(value):
            raise MoveError(f"{name} is {value}; it has to be finite")


def limit_of(**values: float) -> float:
    """Return a time limit or duration [s]; infinite means none. Raises MoveError if it is NaN."""
    ((name, value),) = values.items()
    if value != value:
        raise MoveError(f"{name} is {value}; it has to be a number of seconds")
    return min(value, 1e15)
