"""Edge between AirSim's frames and the bench's: state to NED and FRD, commands to ENU and FLU."""

from __future__ import annotations

from math import sqrt

from hil.apps.airsim.flight.move import Command, MoveError, NedState
from hil.run.stepped.setpoint import Setpoint
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.samples import TruthState, Vec3
from sim.physics.vehicle import Vehicle

HOVER_THROTTLE = 0.586601  # of AirSim's quadrotor: 1 kg, four rotors of 4.179446 N
POSITION_SPEED_MPS = 6.0  # simple_flight's greatest speed towards a position or height without another limit
_HALF_PI = 1.5707963267948966


class NedEdge:
    """Frames of one vehicle. `start_W` is the origin of its NED frame.

    `density_ratio`: density of the air over that of the vehicle's file.
    """

    def __init__(self, vehicle: Vehicle, gravity_mps2: float, start_W: Vec3, *, density_ratio: float = 1.0) -> None:
        self._start_W = start_W
        c = vehicle.rotor_constants
        self._curve = c.thrust_model_factor
        most_n = density_ratio * c.thrust_coefficient_n_per_radps2 * c.max_speed_radps * c.max_speed_radps
        self._full = vehicle.mass_kg * gravity_mps2 / (4.0 * HOVER_THROTTLE * most_n)  # thrust of a pwm of 1
        self._corners = _corners(vehicle)

    def state(self, truth: TruthState, landed: bool) -> NedState:
        """Return the true state as AirSim describes it."""
        p, o = truth.p_WB, self._start_W
        return NedState(
            truth.t_ns,
            ned_from_enu((p[0] - o[0], p[1] - o[1], p[2] - o[2])),
            ned_from_enu(truth.v_WB_W),
            q_NF_from_q_WB(truth.q_WB),
            frd_from_flu(truth.w_WB_B),
            truth.in_contact,
            landed,
        )

    def setpoint(self, command: Command) -> Setpoint:
        """Return the set-point of a command."""
        if command.pwms is not None:
            return Setpoint(rotors=self._rotor_commands(command.pwms))
        o, c = self._start_W, command
        return Setpoint(
            p_xy_m=None if c.p_xy_m is None else (c.p_xy_m[1] + o[0], c.p_xy_m[0] + o[1]),
            v_xy_mps=None if c.v_xy_mps is None else (c.v_xy_mps[1], c.v_xy_mps[0]),
            roll_pitch_rad=None if c.roll_pitch_rad is None else (c.roll_pitch_rad[0], -c.roll_pitch_rad[1]),
            roll_pitch_rate_radps=None
            if c.roll_pitch_rate_radps is None
            else (c.roll_pitch_rate_radps[0], -c.roll_pitch_rate_radps[1]),
            z_m=None if c.z_m is None else o[2] - c.z_m,
            vz_mps=None if c.vz_mps is None else -c.vz_mps,
            thrust_ratio=None if c.throttle is None else max(c.throttle, 0.0) / HOVER_THROTTLE,
            yaw_rad=None if c.yaw_rad is None else _HALF_PI - c.yaw_rad,
            yaw_rate_radps=None if c.yaw_rate_radps is None else -c.yaw_rate_radps,
            speed_limit_mps=POSITION_SPEED_MPS if c.speed_limit_mps is None else c.speed_limit_mps,
        )

    def _rotor_commands(self, pwms: tuple[float, ...]) -> tuple[float, ...]:
        """Return the commands of the rotors with the thrust that AirSim's quadrotor has at these values."""
        if not any(pwms):
            return (0.0,) * 8
        if self._corners is None:
            raise MoveError("moveByMotorPWMs needs a vehicle with four rotors, one at each corner; this one differs")
        f = self._curve
        commands = []
        for corner in self._corners:
            thrust = min(max(pwms[corner], 0.0) * self._full, 1.0)
            commands.append(
                thrust if f == 0.0 else (sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * thrust) - (1.0 - f)) / (2.0 * f)
            )
        return tuple(commands)


def _corners(vehicle: Vehicle) -> list[int] | None:
    """Return the number of every rotor in AirSim's order: front right, rear left, front left, rear right."""
    order = {(True, False): 0, (False, True): 1, (True, True): 2, (False, False): 3}  # front, left
    corners = [order[rotor.position_m[0] > 0.0, rotor.position_m[1] > 0.0] for rotor in vehicle.rotors]
    return corners if sorted(corners) == [0, 1, 2, 3] else None
