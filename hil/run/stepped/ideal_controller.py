"""Ideal flight controller: true state in, rotor commands out, once every tick.

    position   v_d = s(|e|) e / |e|,   s(d) = K_p d, beyond a / K_p^2 sqrt(2 a (d - a / 2 K_p^2)): braking at a
    velocity   a_d = K_v (v_d - v) + dv_d/dt, limited; dv_d/dt = -s'(|e|) (v . e) e / |e|^2 makes both poles real
    height     A commanded climb of zero holds the height at which the vehicle stopped climbing
    force      f_d = m (a_d + g e_z - d_a), tilt and size limited, vertical part first
    thrust     min(f_d,z / cos tilt, |f_d|): a lagging attitude costs horizontal force, not height; with an integral of
               what rotors that cannot follow the torques leave undone
    attitude   w_d = K_q 2 sin(theta/2) n: the shortest rotation of the body's z axis to f_d (reduced attitude,
               Brescianini, Hehn, D'Andrea, ETH 2013); heading about the body's z axis by its own loop
    rates      tau = I (K_w (w_d - w) - d_alpha) + w x I w
    yaw        A rotor that speeds up turns the body by J dO/dt, for a short time far more than by its drag m_ratio T:
               the drag's share of tau_z follows it with the time constant J / (2 k O m_ratio)
    rotors     hil.run.stepped.allocation, then the inverse of thrust curve and motor lag: the command that brings the
               speed to its target with the time constant tau_d instead of the motor's

d_a and d_alpha are the accelerations that the model does not explain (wind, drag, ground, a weak rotor): the true
acceleration of the last tick less that of the rotors' thrust, through a low-pass. They replace integrators: no steady
error, and no wind-up, because the thrust is that of the limited commands. In contact they fade to zero.

On the ground the thrust of a commanded descent falls to idle within half a second: `landed` is then True.

World W is ENU, body B is FLU, SI units. The tick is native code (sim/native/ideal_controller.cpp): the same bits on
every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from hil.run.stepped.allocation import Allocation
from hil.run.stepped.setpoint import IDLE_COMMAND, Setpoint, check
from signals._kernel import det_exp
from signals.samples import TruthState
from signals.time import NS_PER_S
from sim import _kernels
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle

POSITION, VELOCITY, ATTITUDE, RATES = range(4)  # horizontal part of a set-point, for `kernel.aim`
HEIGHT, CLIMB, THRUST = range(3)  # its vertical part
MOST_SPEED_MPS = 15.0  # of the position loop

_RATIO = 2.5  # of the gains of two successive loops
_POSITION_RATIO = 1.6  # of velocity and position: their poles are real, whatever the ratio
_MOST_RATE_GAIN_PER_S = 20.0
_RATE_GAIN_TIMES_DELAY = 0.4
_LAG_LEFT = 1.0 / 3.0  # of a motor's time constant
_DISTURBANCE_TIME_S = 0.05
_YAW_RESERVE = 0.5  # change of the hover thrust that yaw may cause
_RAISED = 0.7  # of the hover thrust, up to which torques may raise the collective thrust


class Gains(NamedTuple):
    """Factors of the loops' gains, by axis: 1 is the controller's own choice for the vehicle."""

    position: tuple[float, float, float] = (1.0, 1.0, 1.0)  # x y z of W
    velocity: tuple[float, float, float] = (1.0, 1.0, 1.0)  # x y z of W
    attitude: tuple[float, float, float] = (1.0, 1.0, 1.0)  # roll, pitch, yaw
    rate: tuple[float, float, float] = (1.0, 1.0, 1.0)  # roll, pitch, yaw


class IdealController:
    """Controller of one vehicle. Raises ValueError if its rotors cannot produce all torques and thrust.

    `density_ratio`: density of the air over that of the vehicle's file.
    """

    def __init__(self, vehicle: Vehicle, tick_ns: int, gravity_mps2: float, *, density_ratio: float = 1.0) -> None:
        c = vehicle.rotor_constants
        dt = tick_ns / NS_PER_S
        weight_n = vehicle.mass_kg * gravity_mps2
        k, inertia = density_ratio * c.thrust_coefficient_n_per_radps2, vehicle.inertia_kgm2
        idle_radps = multirotor.speed_radps(vehicle, IDLE_COMMAND)
        allocation = Allocation(vehicle, least_n=k * idle_radps * idle_radps, density_ratio=density_ratio)
        hover_n = weight_n / allocation.lift  # of one rotor
        usual_n = max(hover_n, 0.05 * allocation.most_n)  # without gravity a rotor hardly turns
        allocation.raised_n = _RAISED * usual_n * allocation.lift
        most_yaw_accel = allocation.yaw_torque_nm(_YAW_RESERVE * usual_n) / inertia[2]

        lag_s = max(_LAG_LEFT * c.time_constant_up_s, dt)
        target = 1.0 - det_exp(-dt / lag_s)
        decay_up, decay_down = det_exp(-dt / c.time_constant_up_s), det_exp(-dt / c.time_constant_down_s)
        reaction = [-c.inertia_kgm2 * rotor.spin.sign * rotor.axis[2] / dt for rotor in vehicle.rotors]
        reaction_s = c.inertia_kgm2 / (2.0 * sqrt(k * usual_n) * max(c.moment_ratio_m, 1e-6))
        rate = min(_MOST_RATE_GAIN_PER_S, _RATE_GAIN_TIMES_DELAY / (lag_s + 1.5 * dt))
        self._base = (rate, rate / _RATIO, rate / _RATIO**2, rate / _RATIO**2 / _POSITION_RATIO)
        self.kernel = _kernels.IdealController(
            mix=allocation.mix,
            limits_n=(allocation.least_n, allocation.most_n, allocation.raised_n),
            columns=np.array(allocation.columns),
            reaction=np.array(reaction),
            body=(vehicle.mass_kg, *inertia, gravity_mps2, dt),
            rotor=(k, c.max_speed_radps, c.thrust_model_factor),
            bounds=(hover_n, 0.95 * allocation.most_n * allocation.lift, most_yaw_accel),
            filters=(
                target / (1.0 - decay_up),
                target / (1.0 - decay_down),
                decay_up,
                decay_down,
                1.0 - det_exp(-dt / _DISTURBANCE_TIME_S),
                dt / (dt + reaction_s),
            ),
        )
        self._commands = self.kernel.commands
        self._aimed: Setpoint | None = None
        self.set_gains(Gains())

    def set_gains(self, gains: Gains) -> None:
        """Multiply the gains of the loops by factors. Raises ValueError unless they are in 0..20."""
        for name, values in zip(gains._fields, gains, strict=True):
            for value in values:
                if not 0.0 <= value <= 20.0:
                    raise ValueError(f"the factor of the {name} gain is {value:g}; it goes from 0 to 20")
        rate, attitude, velocity, position = self._base
        self._gains = gains
        (px, py, pz), (vx, vy, vz), (qx, qy, qz), (wx, wy, wz) = gains
        self.kernel.set_gains(
            (position * px, position * py, position * pz),
            (velocity * vx, velocity * vy, 1.5 * velocity * vz),
            (attitude * qx, attitude * qy, 0.6 * attitude * qz),
            (rate * wx, rate * wy, 0.6 * rate * wz),
        )

    @property
    def gains(self) -> Gains:
        """Factors of the gains."""
        return self._gains

    def reset(self) -> None:
        """Forget the past: call it after the vehicle was moved, or its rotors stopped, from outside."""
        self.kernel.reset()

    @property
    def landed(self) -> bool:
        """True if the vehicle stands on the ground with its rotors idling, and the set-point commands no climb."""
        return self.kernel.press >= 1.0

    def controls(self, truth: TruthState, setpoint: Setpoint) -> Sequence[float]:
        """Return the command 0..1 of every rotor, in the vehicle's order, until the next tick.

        Raises ValueError if the set-point has a wrong combination of values or one that is not finite.
        """
        if setpoint is not self._aimed:
            self.aim(setpoint)
        return self._commands(
            truth.p_WB,
            truth.q_WB,
            truth.v_WB_W,
            truth.w_WB_B,
            truth.a_WB_W,
            truth.alpha_WB_B,
            truth.rotor_speed_radps,
            truth.in_contact,
        )

    def aim(self, setpoint: Setpoint) -> None:
        """Fly a set-point from the next tick on, for `SteppedWorld.hold`. Raises ValueError as `controls`."""
        check(setpoint)
        s = setpoint
        if s.rotors is not None:
            self.kernel.aim_rotors(s.rotors)
        else:
            levels = (s.p_xy_m, s.v_xy_mps, s.roll_pitch_rad, s.roll_pitch_rate_radps)  # POSITION ... RATES
            heights = (s.z_m, s.vz_mps, s.thrust_ratio)  # HEIGHT ... THRUST
            level = next(i for i, value in enumerate(levels) if value is not None)
            height = next(i for i, value in enumerate(heights) if value is not None)
            a, b = levels[level] or (0.0, 0.0)
            turns = s.yaw_rad is None
            yaw = s.yaw_rate_radps if turns else s.yaw_rad
            limit = s.speed_limit_mps if s.speed_limit_mps is not None else MOST_SPEED_MPS
            self.kernel.aim(level, a, b, height, heights[height] or 0.0, turns, yaw or 0.0, limit)
        self._aimed = setpoint
