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

World W is ENU, body B is FLU, SI units. + - * / sqrt and functions of signals._kernel only: the same bits on every
machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import fmod, sqrt
from typing import NamedTuple

from hil.run.stepped.allocation import Allocation
from hil.run.stepped.setpoint import IDLE_COMMAND, IDLE_COMMANDS, STOPPED_COMMANDS, Setpoint, check
from signals._kernel import det_atan2, det_cos, det_exp, det_sin
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.vehicle import Vehicle

_PI = 3.141592653589793
_TWO_PI = 2.0 * _PI

_RATIO = 2.5  # of the gains of two successive loops
_POSITION_RATIO = 1.6  # of velocity and position: their poles are real, whatever the ratio
_MOST_RATE_GAIN_PER_S = 20.0
_RATE_GAIN_TIMES_DELAY = 0.4
_LAG_LEFT = 1.0 / 3.0  # of a motor's time constant
_DISTURBANCE_TIME_S = 0.05
_MOST_LEVEL_ACCEL_MPS2 = 6.0
_MOST_CLIMB_ACCEL_MPS2 = 5.0
_MOST_ACCEL_TAN = 0.7  # 35 degrees of tilt for acceleration; more against wind and drag
_BRAKE_ACCEL_MPS2 = 3.5
_STRAIGHT_ACCEL_MPS2, _LEAD_S = 5.0, 0.3125  # speeding up in all axes at once keeps the way to a position straight
_YAW_BRAKE_SHARE = 0.5  # of the greatest yaw acceleration
_MOST_SPEED_MPS = 15.0  # of the position loop
_MOST_TILT_TAN, _LEAST_TILT_COS = 1.7320508075688772, 0.5  # 60 degrees
_MOST_TILT_RATE_RADPS = 5.0
_MOST_YAW_RATE_RADPS = 2.5
_YAW_RESERVE = 0.5  # change of the hover thrust that yaw may cause
_RAISED = 0.7  # of the hover thrust, up to which torques may raise the collective thrust
_MOST_MISSING = 0.5  # thrust over weight
_STEERABLE = 0.1  # thrust over weight below which all rotors get the same command
_LOCK_YAW_RATE_RADPS, _LOCK_YAW_ERROR_RAD = 0.05, 0.3
_LOCK_CLIMB_MPS, _LOCK_HEIGHT_ERROR_M = 0.05, 0.5
_DESCENT_MPS = -0.05  # a commanded vertical speed below it is a descent
_PRESS_PER_S = 2.0  # of g
_TOUCH_DOWN_S = 0.3


class Gains(NamedTuple):
    """Factors of the loops' gains, by axis: 1 is the controller's own choice for the vehicle."""

    position: tuple[float, float, float] = (1.0, 1.0, 1.0)  # x y z of W
    velocity: tuple[float, float, float] = (1.0, 1.0, 1.0)  # x y z of W
    attitude: tuple[float, float, float] = (1.0, 1.0, 1.0)  # roll, pitch, yaw
    rate: tuple[float, float, float] = (1.0, 1.0, 1.0)  # roll, pitch, yaw


class IdealController:
    """Controller of one vehicle. Raises ValueError if its rotors cannot produce all torques and thrust."""

    def __init__(self, vehicle: Vehicle, tick_ns: int, gravity_mps2: float) -> None:
        c = vehicle.rotor_constants
        dt = self._dt_s = tick_ns / NS_PER_S
        self._g, self._mass, self._inertia = gravity_mps2, vehicle.mass_kg, vehicle.inertia_kgm2
        self._weight_n = vehicle.mass_kg * gravity_mps2
        self._count = len(vehicle.rotors)
        self._k, self._most_radps = c.thrust_coefficient_n_per_radps2, c.max_speed_radps
        self._curve = c.thrust_model_factor
        idle_radps = vehicle.speed_radps(IDLE_COMMAND)
        self._allocation = Allocation(vehicle, least_n=self._k * idle_radps * idle_radps)
        self._hover_n = self._weight_n / self._allocation.lift  # of one rotor
        self._most_thrust_n = 0.95 * self._allocation.most_n * self._allocation.lift
        usual_n = max(self._hover_n, 0.05 * self._allocation.most_n)  # without gravity a rotor hardly turns
        self._allocation.raised_n = _RAISED * usual_n * self._allocation.lift
        yaw_torque_nm = self._allocation.yaw_torque_nm(_YAW_RESERVE * usual_n)
        self._most_yaw_accel = yaw_torque_nm / self._inertia[2]

        lag_s = max(_LAG_LEFT * c.time_constant_up_s, dt)
        target = 1.0 - det_exp(-dt / lag_s)
        self._decay_up, self._decay_down = det_exp(-dt / c.time_constant_up_s), det_exp(-dt / c.time_constant_down_s)
        self._lead_up, self._lead_down = target / (1.0 - self._decay_up), target / (1.0 - self._decay_down)
        self._fade = 1.0 - det_exp(-dt / _DISTURBANCE_TIME_S)
        self._reaction = [-c.inertia_kgm2 * rotor.spin.sign * rotor.axis[2] / dt for rotor in vehicle.rotors]
        reaction_s = c.inertia_kgm2 / (2.0 * sqrt(self._k * usual_n) * max(c.moment_ratio_m, 1e-6))
        self._yaw_share = dt / (dt + reaction_s)
        rate = min(_MOST_RATE_GAIN_PER_S, _RATE_GAIN_TIMES_DELAY / (lag_s + 1.5 * dt))
        self._base = (rate, rate / _RATIO, rate / _RATIO**2, rate / _RATIO**2 / _POSITION_RATIO)
        self.set_gains(Gains())
        self.reset()

    def set_gains(self, gains: Gains) -> None:
        """Multiply the gains of the loops by factors. Raises ValueError unless they are in 0..20."""
        for name, values in zip(gains._fields, gains, strict=True):
            for value in values:
                if not 0.0 <= value <= 20.0:
                    raise ValueError(f"the factor of the {name} gain is {value:g}; it goes from 0 to 20")
        rate, attitude, velocity, position = self._base
        self._gains = gains
        (px, py, pz), (vx, vy, vz), (qx, qy, qz), (wx, wy, wz) = gains
        self._kp = (position * px, position * py, position * pz)
        self._kv = (velocity * vx, velocity * vy, 1.5 * velocity * vz)
        self._kq = (attitude * qx, attitude * qy, 0.6 * attitude * qz)
        self._kw = (rate * wx, rate * wy, 0.6 * rate * wz)

    @property
    def gains(self) -> Gains:
        """Factors of the gains."""
        return self._gains

    def reset(self) -> None:
        """Forget the past: call it after the vehicle was moved, or its rotors stopped, from outside."""
        self._fresh = True  # the next call takes the true speeds of the rotors
        self._speeds: list[float] = []  # by the model of the motors
        self._squares: list[float] = []  # mean of O^2 over the last tick; empty before the first
        self._spin_up_nm = 0.0  # mean torque about z of the last tick by the acceleration of the rotors
        self._yaw_torque_nm = 0.0  # by the thrust alone
        self._made_n = 0.0  # mean thrust of the last tick, by the model of the motors
        self._missing_n = 0.0  # integral of the commanded thrust less the produced one
        self._press = 0.0  # share of the weight that is left to the ground
        self._touched_s = _TOUCH_DOWN_S  # since the last contact
        self._locked_yaw: float | None = None
        self._locked_z_m: float | None = None
        self._checked: Setpoint | None = None
        self._forget_disturbance()

    @property
    def landed(self) -> bool:
        """True if the vehicle stands on the ground with its rotors idling, and the set-point commands no climb."""
        return self._press >= 1.0

    def controls(self, truth: TruthState, setpoint: Setpoint) -> Sequence[float]:
        """Return the command 0..1 of every rotor, in the vehicle's order, until the next tick.

        Raises ValueError if the set-point has a wrong combination of values or one that is not finite.
        """
        if setpoint is not self._checked:
            check(setpoint)
            self._checked = setpoint
        w, x, y, z = truth.q_WB
        R = (
            1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
            2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
            2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
        )  # fmt: skip
        if self._fresh:
            self._fresh = False
            self._speeds = list(truth.rotor_speed_radps)
        if setpoint.rotors is not None:
            self._forget_disturbance()
            return self._direct(setpoint.rotors)
        wx, wy, wz = truth.w_WB_B
        ix, iy, iz = self._inertia
        gyroscopic = gx, gy, gz = (iz - iy) * wy * wz, (ix - iz) * wz * wx, (iy - ix) * wx * wy
        if truth.in_contact:
            self._fade_disturbance()
        elif self._squares:
            self._observe(truth, R, gyroscopic)

        force = self._force(truth, setpoint)
        if truth.in_contact and R[8] < _LEAST_TILT_COS:  # lies on its side: thrust would only press it there
            return self._direct(STOPPED_COMMANDS)
        if self._press >= 1.0:
            self._locked_yaw = None
            return self._direct(IDLE_COMMANDS)
        if R[8] > _LEAST_TILT_COS:
            fx, fy, fz = force
            thrust = min(fz / R[8], sqrt(fx * fx + fy * fy + fz * fz))
        else:
            thrust = force[2] * max(R[8], 0.0) / (_LEAST_TILT_COS * _LEAST_TILT_COS)
        if setpoint.thrust_ratio is not None:
            thrust = setpoint.thrust_ratio * self._weight_n
            if setpoint.thrust_ratio < _STEERABLE:
                return self._to_commands([setpoint.thrust_ratio * self._hover_n] * self._count)
        elif setpoint.p_xy_m is None and setpoint.v_xy_mps is None:
            thrust = force[2] / max(R[8], _LEAST_TILT_COS)  # height is held at any attitude
        thrust = min(max(thrust, 0.0), self._most_thrust_n)
        if self._squares and not truth.in_contact:
            most = _MOST_MISSING * self._weight_n
            self._missing_n = min(max(self._missing_n + self._fade * (thrust - self._made_n), -most), most)
        thrust = max(thrust + self._missing_n, 0.0)

        wx_d, wy_d = self._tilt_rates(R, force, setpoint)
        kx, ky, kz = self._kw
        most = self._most_yaw_accel
        yaw_accel = min(max(kz * (self._yaw_rate(R, wz, setpoint) - wz) - self._ez, -most), most)
        self._yaw_torque_nm += self._yaw_share * (iz * yaw_accel + gz - self._yaw_torque_nm)
        return self._to_commands(
            self._allocation.thrusts(
                ix * (kx * (wx_d - wx) - self._ex) + gx,
                iy * (ky * (wy_d - wy) - self._ey) + gy,
                self._yaw_torque_nm,
                thrust,
            )
        )

    # -- disturbance ------------------------------------------------------------------------------------------------

    def _forget_disturbance(self) -> None:
        self._dx = self._dy = self._dz = 0.0  # d_a in W
        self._ex = self._ey = self._ez = 0.0  # d_alpha in B
        self._missing_n = 0.0
        self._press = 0.0
        self._locked_yaw = self._locked_z_m = None

    def _fade_disturbance(self) -> None:
        left = 1.0 - self._fade
        self._missing_n *= left
        self._dx *= left
        self._dy *= left
        self._dz *= left
        self._ex *= left
        self._ey *= left
        self._ez *= left

    def _observe(self, truth: TruthState, R: tuple[float, ...], gyroscopic: Vec3) -> None:
        """Update d_a and d_alpha with the mean acceleration of the last tick and that of the rotors' thrust."""
        fade, k = self._fade, self._k
        tx = ty = tz = f = 0.0
        for square, (bx, by, bz, bf) in zip(self._squares, self._allocation.columns, strict=True):
            force = k * square
            tx += bx * force
            ty += by * force
            tz += bz * force
            f += bf * force
        self._made_n = f
        f /= self._mass
        ax, ay, az = truth.a_WB_W
        self._dx += fade * (ax - R[2] * f - self._dx)
        self._dy += fade * (ay - R[5] * f - self._dy)
        self._dz += fade * (az + self._g - R[8] * f - self._dz)
        ix, iy, iz = self._inertia
        gx, gy, gz = gyroscopic
        px, py, pz = truth.alpha_WB_B
        self._ex += fade * (px - (tx - gx) / ix - self._ex)
        self._ey += fade * (py - (ty - gy) / iy - self._ey)
        self._ez += fade * (pz - (tz + self._spin_up_nm - gz) / iz - self._ez)

    # -- position and velocity --------------------------------------------------------------------------------------

    def _force(self, truth: TruthState, setpoint: Setpoint) -> Vec3:
        """Return f_d in W, limited. Only z counts if no horizontal motion is commanded."""
        vx, vy, vz = truth.v_WB_W
        kx, ky, kz = self._kv
        limit = setpoint.speed_limit_mps if setpoint.speed_limit_mps is not None else _MOST_SPEED_MPS
        px, py, pz = truth.p_WB
        tx, ty = setpoint.p_xy_m if setpoint.p_xy_m is not None else (px, py)
        tz = setpoint.z_m if setpoint.z_m is not None else pz
        dx, dy, dz = tx - px, ty - py, tz - pz
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        gx, gy, gz = self._kp
        dx, dy, dz = gx * dx, gy * dy, gz * dz
        wanted = sqrt(dx * dx + dy * dy + dz * dz)
        sx = sy = sz = 0.0  # commanded velocity
        ax = ay = az = 0.0
        if wanted > 1e-9:
            dx, dy, dz = dx / wanted, dy / wanted, dz / wanted
            speed, slope = _approach(distance, wanted / distance, _BRAKE_ACCEL_MPS2, limit)
            ahead = dx * vx + dy * vy + dz * vz
            speed = min(speed, max(ahead, 0.0) + _LEAD_S * _STRAIGHT_ACCEL_MPS2)
            sx, sy, sz = speed * dx, speed * dy, speed * dz
            slope *= ahead
            ax, ay, az = -slope * dx, -slope * dy, -slope * dz
        if setpoint.v_xy_mps is not None:
            sx, sy = setpoint.v_xy_mps
            ax = ay = 0.0
        if setpoint.vz_mps is not None:
            sz = setpoint.vz_mps or self._hold_height(truth)
            az = 0.0
        if setpoint.vz_mps != 0.0:
            self._locked_z_m = None
        ax, ay, az = ax + kx * (sx - vx), ay + ky * (sy - vy), az + kz * (sz - vz)
        az = min(max(az, -_MOST_CLIMB_ACCEL_MPS2), _MOST_CLIMB_ACCEL_MPS2)
        level, most = sqrt(ax * ax + ay * ay), min(_MOST_LEVEL_ACCEL_MPS2, _MOST_ACCEL_TAN * (self._g + az))
        if level > most:
            ax, ay = ax * (most / level), ay * (most / level)
        self._press_down(truth, sz)

        mass = self._mass
        fz = mass * (az + self._g * (1.0 - self._press) - self._dz)
        fz = min(max(fz, 0.1 * self._weight_n * (1.0 - self._press)), self._most_thrust_n)
        fx, fy = mass * (ax - self._dx), mass * (ay - self._dy)
        if self._touched_s < _TOUCH_DOWN_S and sz < _DESCENT_MPS:
            return 0.0, 0.0, fz  # touch-down: upright, so that a skidding vehicle does not tip over
        level = sqrt(fx * fx + fy * fy)
        most = min(_MOST_TILT_TAN * fz, sqrt(max(0.0, self._most_thrust_n * self._most_thrust_n - fz * fz)))
        if level > most:
            fx, fy = fx * (most / level), fy * (most / level)
        return fx, fy, fz

    def _hold_height(self, truth: TruthState) -> float:
        """Return the climb that holds the height at which the vehicle stopped climbing; 0 until then."""
        z_m = truth.p_WB[2]
        if truth.in_contact or self._touched_s < _TOUCH_DOWN_S:
            self._locked_z_m = None
        elif self._locked_z_m is None and abs(truth.v_WB_W[2]) < _LOCK_CLIMB_MPS:
            self._locked_z_m = z_m
        elif self._locked_z_m is not None and abs(self._locked_z_m - z_m) > _LOCK_HEIGHT_ERROR_M:
            self._locked_z_m = None  # pushed away from outside: do not fly back
        return 0.0 if self._locked_z_m is None else self._kp[2] * (self._locked_z_m - z_m)

    def _press_down(self, truth: TruthState, climb_mps: float) -> None:
        """On the ground, give the weight to the ground while a descent is commanded, and take it back otherwise."""
        step = _PRESS_PER_S * self._dt_s
        self._touched_s = 0.0 if truth.in_contact else self._touched_s + self._dt_s
        if truth.in_contact and climb_mps < _DESCENT_MPS and truth.v_WB_W[2] > 0.5 * climb_mps:
            self._press = min(1.0, self._press + step)
        elif self._press > 0.0:
            self._press = max(0.0, self._press - 2.0 * step)

    # -- attitude ---------------------------------------------------------------------------------------------------

    def _tilt_rates(self, R: tuple[float, ...], force: Vec3, setpoint: Setpoint) -> tuple[float, float]:
        """Return w_d about x and y of B."""
        if setpoint.roll_pitch_rate_radps is not None:
            return setpoint.roll_pitch_rate_radps
        turn = 0.0  # rate about z of W at which the wanted axis turns
        if setpoint.roll_pitch_rad is not None:
            roll, pitch = setpoint.roll_pitch_rad
            cr, sr, cp, sp = det_cos(roll), det_sin(roll), det_cos(pitch), det_sin(pitch)
            forward = sqrt(R[0] * R[0] + R[3] * R[3])
            c, s = (R[0] / forward, R[3] / forward) if forward > 1e-6 else (1.0, 0.0)
            zx, zy, zz = c * sp * cr + s * sr, s * sp * cr - c * sr, cp * cr
            turn = setpoint.yaw_rate_radps or 0.0
        else:
            fx, fy, fz = force
            size = sqrt(fx * fx + fy * fy + fz * fz)
            zx, zy, zz = (fx / size, fy / size, fz / size) if size > 0.0 else (0.0, 0.0, 1.0)
        # z of B x z_d, turned into B: its components along x and y of B.
        bx, by = -(R[1] * zx + R[4] * zy + R[7] * zz), R[0] * zx + R[3] * zy + R[6] * zz
        cosine = R[2] * zx + R[5] * zy + R[8] * zz
        kx, ky, _ = self._kq
        half = sqrt(max(0.0, 2.0 * (1.0 + cosine)))  # 2 cos(theta/2)
        if half > 0.02:
            wx, wy = kx * 2.0 * bx / half, ky * 2.0 * by / half
        else:
            wx, wy = _MOST_TILT_RATE_RADPS, 0.0  # upside down: over the side
        size = sqrt(wx * wx + wy * wy)
        if size > _MOST_TILT_RATE_RADPS:
            wx, wy = wx * (_MOST_TILT_RATE_RADPS / size), wy * (_MOST_TILT_RATE_RADPS / size)
        return wx + turn * R[6], wy + turn * R[7]

    def _yaw_rate(self, R: tuple[float, ...], wz: float, setpoint: Setpoint) -> float:
        """Return w_d about z of B. A commanded rate of zero holds the heading once the vehicle has stopped turning."""
        target, rate = setpoint.yaw_rad, setpoint.yaw_rate_radps
        yaw = det_atan2(R[3], R[0])
        if target is None:
            if rate:
                self._locked_yaw = None
                return rate
            if self._locked_yaw is None:
                if abs(wz) > _LOCK_YAW_RATE_RADPS:
                    return 0.0
                self._locked_yaw = yaw
            target = self._locked_yaw
        else:
            self._locked_yaw = None
        error = fmod(target - yaw, _TWO_PI)  # exact, and so the same everywhere
        error += _TWO_PI if error < -_PI else -_TWO_PI if error > _PI else 0.0
        if self._locked_yaw is not None and abs(error) > _LOCK_YAW_ERROR_RAD:
            self._locked_yaw = None  # pushed away from outside: do not turn back
            return 0.0
        speed, _ = _approach(abs(error), self._kq[2], _YAW_BRAKE_SHARE * self._most_yaw_accel, _MOST_YAW_RATE_RADPS)
        return speed if error > 0.0 else -speed

    # -- rotors -----------------------------------------------------------------------------------------------------

    def _to_commands(self, thrust_n: Sequence[float]) -> list[float]:
        """Return the commands that bring the rotors to their thrust, and advance the model of the motors."""
        k, top, f, speeds = self._k, self._most_radps, self._curve, self._speeds
        commands, squares, spin_up_nm = [], [], 0.0
        for i, thrust in enumerate(thrust_n):
            now = speeds[i]
            target = sqrt(thrust / k) if thrust > 0.0 else 0.0
            command = now + (target - now) * (self._lead_up if target > now else self._lead_down)
            command = min(max(command, 0.0), top)
            after = command + (now - command) * (self._decay_up if command > now else self._decay_down)
            speeds[i] = after
            squares.append((now * now + now * after + after * after) / 3.0)
            spin_up_nm += self._reaction[i] * (after - now)
            u = command / top
            if f != 1.0:
                u *= u
                if f > 0.0:
                    u = (sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * u) - (1.0 - f)) / (2.0 * f)
            commands.append(u)
        self._squares, self._spin_up_nm = squares, spin_up_nm
        return commands

    def _direct(self, commands: Sequence[float]) -> Sequence[float]:
        """Return the commands themselves, and advance the model of the motors."""
        top, f, speeds = self._most_radps, self._curve, self._speeds
        commands = [min(max(u, 0.0), 1.0) for u in commands[: self._count]]
        self._squares = []
        for i, u in enumerate(commands):
            now, command = speeds[i], top * sqrt(f * u * u + (1.0 - f) * u)
            speeds[i] = command + (now - command) * (self._decay_up if command > now else self._decay_down)
            self._squares.append((now * now + now * speeds[i] + speeds[i] * speeds[i]) / 3.0)
        return commands


def _approach(distance: float, gain: float, brake: float, limit: float) -> tuple[float, float]:
    """Return the speed s(distance) towards a target, at most `limit`, and its slope s'."""
    if gain * gain * distance <= brake:
        speed, slope = gain * distance, gain
    else:
        speed = sqrt(2.0 * brake * (distance - 0.5 * brake / (gain * gain)))
        slope = brake / speed
    return (limit, 0.0) if speed > limit else (speed, slope)
