"""Interface of AirSim's moves: state machines that return a command every 20 ms of simulated time.

Everything here is in AirSim's frames: NED from the place where the vehicle started, body FRD. `flight.ned` turns it
into the bench's frames.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from signals.rotation import yaw_of
from signals.samples import Quat, Vec3
from signals.time import NS_PER_MS

PERIOD_NS = 20 * NS_PER_MS  # AirSim's command period
PERIOD_S = 0.02
ACCURACY_M = 0.5  # AirSim's distance accuracy of simple_flight: a place nearer than this is reached
Xy = tuple[float, float]


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
    throttle: float | None = None  # 0..1 as AirSim's quadrotor takes it: 0.5868 hovers
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None
    speed_limit_mps: float | None = None  # of the way to a position
    pwms: tuple[float, float, float, float] | None = None  # front right, rear left, front left, rear right


NOTHING = Command()  # sends nothing: the last command goes on, until the vehicle hovers


class Move(Protocol):
    """Move that `SimpleFlight.start` runs. It begins with the first step."""

    succeeded: bool  # AirSim's return value, valid once `step` has returned None

    def step(self, state: NedState) -> Command | None:
        """Return the command of the next 20 ms; None: the move is over. Raises MoveError."""
        ...
