"""Moves that send one kind of command for a duration: AirSim's moveBy* and rotateByYawRate.

AirSim sends a command every 20 ms, and at least one; the move ends with the first period that reaches the duration and
returns True. A duration of 0 or less sends nothing and returns True (moveByVelocityZ: False).

Differences from AirSim: none in time. `throttle` and `pwm` are those of AirSim's quadrotor, whatever the vehicle:
0.5866 hovers, and a thrust that the vehicle does not have is limited.
"""

from __future__ import annotations

from collections.abc import Callable

from hil.apps.airsim.flight.move import NOTHING, Clock, Command, NedState, Xy, finite, limit_of
from hil.apps.airsim.flight.yaw import YawMode, check_heading, heading_of
from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import RAD_PER_DEG


class Timed:
    """Move of fixed length. `begin` gives the command from the state at its start."""

    def __init__(self, duration_s: float, begin: Callable[[NedState], Command], *, empty: bool = True) -> None:
        duration_s = limit_of(duration=duration_s)
        self.succeeded = empty if duration_s <= 0.0 else False
        self._empty = duration_s <= 0.0
        self._clock = Clock(duration_s)
        self._begin = begin
        self._command = NOTHING

    def step(self, state: NedState) -> Command | None:
        """Return the command, the same every time; None after the duration."""
        if self._empty:
            return None
        if self._command is NOTHING:
            self._command = self._begin(state)
        if self._clock.over(state.t_ns):
            self.succeeded = True
            return None
        return self._command


def always(command: Command) -> Callable[[NedState], Command]:
    """Return the function that gives this command at every state."""
    return lambda _state: command


def move_by_velocity(
    velocity_mps: Vec3, duration_s: float, drivetrain: int, yaw_mode: YawMode, *, body: bool = False
) -> Timed:
    """Fly at a velocity in NED; `body`: along the heading at the start of the move, z is down."""
    vx, vy, vz = velocity_mps
    finite(vx=vx, vy=vy, vz=vz)
    check_heading(yaw_mode, drivetrain)
    return Timed(duration_s, _at_velocity((vx, vy), Command(vz_mps=vz), drivetrain, yaw_mode, body=body))


def move_by_velocity_z(
    velocity_mps: Xy, z_m: float, duration_s: float, drivetrain: int, yaw_mode: YawMode, *, body: bool = False
) -> Timed:
    """Fly at a horizontal velocity in NED, or along the heading at the start of the move, and a height."""
    vx, vy = velocity_mps
    finite(vx=vx, vy=vy, z=z_m)
    check_heading(yaw_mode, drivetrain)
    return Timed(duration_s, _at_velocity((vx, vy), Command(z_m=z_m), drivetrain, yaw_mode, body=body), empty=body)


def _at_velocity(
    v_mps: Xy, vertical: Command, drivetrain: int, yaw_mode: YawMode, *, body: bool
) -> Callable[[NedState], Command]:
    def begin(state: NedState) -> Command:
        course = _from_heading(v_mps, state.yaw_rad) if body else v_mps
        return vertical._replace(v_xy_mps=course, **heading_of(yaw_mode, drivetrain, course)._asdict())

    return begin


def _from_heading(v_mps: Xy, yaw_rad: float) -> Xy:
    c, s = det_cos(yaw_rad), det_sin(yaw_rad)
    return (v_mps[0] * c - v_mps[1] * s, v_mps[0] * s + v_mps[1] * c)


def move_by_motor_pwms(pwms: tuple[float, float, float, float], duration_s: float) -> Timed:
    """Set the four rotors, 0..1: front right, rear left, front left, rear right. Others are limited to that range."""
    front_right, rear_left, front_left, rear_right = pwms
    finite(front_right_pwm=front_right, rear_left_pwm=rear_left, front_left_pwm=front_left, rear_right_pwm=rear_right)
    return Timed(duration_s, always(Command(pwms=pwms)))


def move_by_attitude(duration_s: float, **held: float) -> Timed:
    """Hold angles or turn at rates about the body's axes, with a height or a throttle.

    `held`: roll and pitch, or roll_rate and pitch_rate; yaw or yaw_rate [rad, rad/s, FRD and NED]; z [m] or throttle.
    """
    finite(**held)
    command = Command(
        roll_pitch_rad=(held["roll"], held["pitch"]) if "roll" in held else None,
        roll_pitch_rate_radps=(held["roll_rate"], held["pitch_rate"]) if "roll_rate" in held else None,
        z_m=held.get("z"),
        throttle=held.get("throttle"),
        yaw_rad=held.get("yaw"),
        yaw_rate_radps=held.get("yaw_rate"),
    )
    return Timed(duration_s, always(command))


def rotate_by_yaw_rate(yaw_rate_degps: float, duration_s: float) -> Timed:
    """Turn at a rate [deg/s, clockwise] over the place where the move began."""
    finite(yaw_rate=yaw_rate_degps)

    def begin(state: NedState) -> Command:
        x, y, z = state.p_m
        return Command(p_xy_m=(x, y), z_m=z, yaw_rate_radps=yaw_rate_degps * RAD_PER_DEG)

    return Timed(duration_s, begin)
