"""Strapdown navigation: position, velocity and attitude from gyro and accelerometer, corrected by slower measurements.

    w = (1 + k) (w_gyro - b_g)
    q' = q exp(w dt)     v' = v + (R (f - b_a) + g) dt     p' = p + v dt + ...

A Kalman filter estimates 15 errors: position, velocity, attitude (in W), b_g and b_a; with `scale_sigma` also the
gyro's three scales k, which matter if the vehicle turns always the same way. The filter's state is that of
the last `advance`; later rows of the IMU are queued, and `predict` adds them for the present state. A late measurement
(GPS) is compared with the recorded state at its own time, and the difference corrects the present state.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple, Sequence

import numpy as np

from hil_companion.navigation.rotation import matrix_of, product, quaternion_of, roll_pitch_yaw, skew, turned

G_MPS2 = 9.80665
_KEPT_ROWS = 1000  # recorded states: a second at 1 kHz
_MAX_QUEUED = 4096
_GYRO_RAD_PER_RTS, _ACCEL_MPS_PER_RTS = 5e-4, 0.02  # noise, including vibration and scale errors
_GYRO_WALK, _ACCEL_WALK = 2e-5, 2e-3
_MAX_RADPS, _MAX_MPS2 = 60.0, 400.0  # beyond the range of a drone's gyro and accelerometer: such rows are errors
# A gap between rows longer than GAP_S is bridged by a model: constant velocity for _REACTION_S; then the vehicle
# brakes because its IMU is silent, and speed and tilt decay with these time constants.
GAP_S = 0.05
_REACTION_S, _STOP_S, _LEVEL_S = 0.3, 1.0, 0.5
_COAST_MPS_PER_RTS, _COAST_RAD_PER_RTS = 1.5, 0.3  # process noise of velocity and heading during a gap
_TILT_RAD, _SPIN_RADPS = 0.15, 0.25  # tilt that may build up unobserved, and the rate at which it does
_UNSURE_TILT_RAD = 0.04  # above this tilt uncertainty, gravity corrects roll and pitch
_SHAKE_MPS2 = 2.0  # noise of that correction: the vehicle's own acceleration

XY, Z, XYZ, SPEED, YAW = (0, 1), (2,), (0, 1, 2), (3, 4, 5), (8,)  # indices of errors
P, V, TH, BG, BA = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15)
K_G = slice(15, 18)  # only with `scale_sigma`


class NavState(NamedTuple):
    """Position, velocity and attitude of the vehicle at one time, in W."""

    t_ns: int
    p: tuple[float, float, float]
    v: tuple[float, float, float]
    q: tuple[float, float, float, float]


class InertialFilter:
    """Error-state Kalman filter. `start_W`: x, y, z [m], yaw [rad], at rest and level to two degrees.

    `scale_sigma`: standard deviation of the gyro's scales, constant in a flight; 0: they are exactly one.
    """

    def __init__(self, start_W: tuple[float, float, float, float], *, scale_sigma: float = 0.0) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        self.p = np.array([x, y, z])
        self.v = np.zeros(3)
        self.q: tuple[float, float, float, float] = (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2)))
        self.gyro_bias = np.zeros(3)
        self.accel_bias = np.zeros(3)
        self.gyro_scale = np.zeros(3)  # k: the rate is 1 + k times what the gyro says without its bias
        sigma = [0.05] * 3 + [0.05] * 3 + [0.035, 0.035, 0.005] + [0.005] * 3 + [0.1] * 3
        sigma += [scale_sigma] * 3 if scale_sigma > 0.0 else []
        self.cov = np.diag(np.array(sigma) ** 2)
        self._count = len(sigma)
        self.t_ns: int | None = None
        self.last_imu_ns: int | None = None
        self._force_W: np.ndarray | None = None  # mean specific force of the last `advance`; None: it had no rows
        self._row_ns: int | None = None  # time of the last integrated row
        self._silent_s = 0.0  # duration of the present gap, as far as it was bridged
        self._rows: deque[tuple[int, tuple[float, ...], tuple[float, ...]]] = deque(maxlen=_MAX_QUEUED)
        self._past: deque[NavState] = deque(maxlen=_KEPT_ROWS)

    def add_rows(
        self,
        t_ns: Sequence[int],
        gyro_radps: Sequence[Sequence[float]],
        accel_mps2: Sequence[Sequence[float]],
        *,
        upto_ns: float = math.inf,
    ) -> None:
        """Queue rows of the IMU, each the mean over the time since the row before.

        Rows that are not finite, beyond any sensor's range or newer than `upto_ns` are left out.
        """
        for t, w, f in zip(t_ns, gyro_radps, accel_mps2):
            sane = max(map(abs, w)) < _MAX_RADPS and max(map(abs, f)) < _MAX_MPS2
            sane = sane and np.isfinite(w).all() and np.isfinite(f).all() and t <= upto_ns
            if sane and (self.last_imu_ns is None or t > self.last_imu_ns):
                self._rows.append((int(t), tuple(w), tuple(f)))
                self.last_imu_ns = int(t)

    def advance(self, to_ns: int) -> None:
        """Advance the state to `to_ns` by the queued rows; after the last row the model of a gap continues it."""
        if self.t_ns is None:
            self.t_ns = self._rows[0][0] if self._rows else to_ns
            self._past.append(self.state())
        began, f_sum, turn_B, used = self.t_ns, np.zeros(3), np.zeros(3), 0
        coasted_s = braked_s = tilt_variance = 0.0
        state = self.state()
        while self._rows and self._rows[0][0] <= to_ns:
            row = self._rows.popleft()
            if row[0] <= state.t_ns:
                continue
            gap_s = (row[0] - state.t_ns) * 1e-9
            if gap_s > GAP_S:
                coasted_s += gap_s
                braked_s += max(0.0, gap_s - _REACTION_S)
                tilt_variance += self._tilt_growth(gap_s)
            self._silent_s, self._row_ns = 0.0, row[0]
            before_ns = state.t_ns
            state, force = self._step(state, row)
            f_sum += force
            if self._count > K_G.start and gap_s <= GAP_S:
                turn_B += (row[0] - before_ns) * 1e-9 * np.array(self._rate_radps(row[1]))
            used += 1
            self._past.append(state)
        if state.t_ns < to_ns:
            rest_s = (to_ns - state.t_ns) * 1e-9
            if _silent(self._row_ns, to_ns):
                coasted_s += rest_s
                braked_s += _brakes_s(rest_s, self._row_ns, to_ns)
                tilt_variance += self._tilt_growth(rest_s)
            state = _coasted(state, to_ns, self._row_ns)
            self._past.append(state)
        self.set_state(state)
        self._force_W = f_sum / used if used else None
        force_W = self._force_W if self._force_W is not None else np.array([0.0, 0.0, G_MPS2])
        self._propagate((state.t_ns - began) * 1e-9, force_W, turn_B, coasted_s, braked_s, tilt_variance)

    def set_state(self, state: NavState) -> None:
        self.t_ns, self.p, self.v, self.q = state.t_ns, np.array(state.p), np.array(state.v), state.q

    def record(self, state: NavState) -> None:
        """Record a given state, such as a true one, in place of rows of the IMU."""
        self.last_imu_ns = state.t_ns
        self._past.append(state)

    @property
    def tilt_sigma_rad(self) -> float:
        """Return the larger standard deviation of roll and pitch."""
        return float(np.sqrt(max(self.cov[6, 6], self.cov[7, 7], 0.0)))

    def level_by_gravity(self) -> None:
        """Correct uncertain roll and pitch by gravity: on average the vehicle does not accelerate."""
        if self._force_W is None or self.tilt_sigma_rad < _UNSURE_TILT_RAD:
            return
        H = self.no_errors(2)
        H[:, TH], H[:, BA] = -skew(self._force_W)[:2], -self.R[:2]
        self.correct(H, -self._force_W[:2], np.full(2, _SHAKE_MPS2**2))

    def state(self) -> NavState:
        """Return the present state."""
        return NavState(self.t_ns or 0, tuple(self.p.tolist()), tuple(self.v.tolist()), self.q)  # type: ignore[arg-type]

    def predict(self, to_ns: int) -> NavState:
        """Return the state at `to_ns` by the queued rows, without changing the filter."""
        state, row_ns = self.state(), self._row_ns
        for row in self._rows:
            if state.t_ns < row[0] <= to_ns:
                state, _ = self._step(state, row)
                row_ns = row[0]
        return _coasted(state, to_ns, row_ns) if state.t_ns < to_ns else state

    def state_at(self, t_ns: int) -> NavState | None:
        """Return the recorded state at a past time, interpolated; None if it is older than the record."""
        past = self._past
        if not past or t_ns < past[0].t_ns:
            return None
        for k in range(len(past) - 1, -1, -1):
            if past[k].t_ns <= t_ns:
                if k + 1 == len(past) or past[k].t_ns == t_ns:
                    return past[k]
                a, b = past[k], past[k + 1]
                s = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
                p = tuple(u + s * (w - u) for u, w in zip(a.p, b.p))
                v = tuple(u + s * (w - u) for u, w in zip(a.v, b.v))
                return NavState(t_ns, p, v, a.q if s < 0.5 else b.q)  # type: ignore[arg-type]
        return None

    def states_since(self, from_ns: int) -> list[NavState]:
        """Return the recorded states from the last one before `from_ns` on, for interpolation."""
        rows: list[NavState] = []
        for state in reversed(self._past):
            rows.append(state)
            if state.t_ns <= from_ns:
                break
        return rows[::-1]

    def no_errors(self, rows: int) -> np.ndarray:
        """Return zeros for the Jacobian of a measurement of `rows` values by the errors."""
        return np.zeros((rows, self._count))

    def row_before(self, t_ns: int) -> int | None:
        """Return the time of the newest row up to `t_ns`, queued or integrated last; None without one."""
        for row in reversed(self._rows):
            if row[0] <= t_ns:
                return row[0]
        return self._row_ns

    def correct(self, H: np.ndarray, innovation: np.ndarray, variance: np.ndarray, gate: float = 0.0) -> bool:
        """Correct by a measurement with independent errors; return False if it is beyond `gate` standard deviations."""
        S = H @ self.cov @ H.T + np.diag(variance)
        solved = np.linalg.solve(S, innovation)
        if gate > 0.0 and float(innovation @ solved) > gate * gate * len(innovation):
            return False
        K = np.linalg.solve(S, H @ self.cov).T
        self._apply(K @ innovation)
        A = np.eye(self._count) - K @ H
        self.cov = A @ self.cov @ A.T + (K * variance) @ K.T
        return True

    def correct_states(
        self, states: Sequence[int], innovation: np.ndarray, variance: np.ndarray, gate: float = 0.0
    ) -> bool:
        """Correct by a direct measurement of some of the states: `XY`, `Z`, `XYZ`, `SPEED` or `YAW`."""
        return self.correct(np.eye(self._count)[list(states)], innovation, variance, gate)

    def correct_place(self, innovation: np.ndarray, variance: np.ndarray, *, above_m: float) -> None:
        """Correct x and y by a match with objects `above_m` above the vehicle; a tilt error displaces these objects.

        p_found - p = d_theta x (0, 0, above)
        """
        H = self.no_errors(2)
        H[0, 0] = H[1, 1] = 1.0
        H[0, 7], H[1, 6] = above_m, -above_m
        self.correct(H, innovation, variance)

    @property
    def R(self) -> np.ndarray:
        return matrix_of(self.q)

    @property
    def yaw_rad(self) -> float:
        return roll_pitch_yaw(self.R)[2]

    def _step(self, m: NavState, row: tuple[int, tuple[float, ...], tuple[float, ...]]) -> tuple[NavState, np.ndarray]:
        t_ns, w, f = row
        dt = (t_ns - m.t_ns) * 1e-9
        if dt > GAP_S:
            m, dt = _coasted(m, t_ns, m.t_ns), 0.0
        wx, wy, wz = self._rate_radps(w)
        half = turned(m.q, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
        q = turned(m.q, dt * wx, dt * wy, dt * wz)
        force = matrix_of(half) @ (np.array(f) - self.accel_bias)
        ax, ay, az = float(force[0]), float(force[1]), float(force[2]) - G_MPS2
        (px, py, pz), (vx, vy, vz) = m.p, m.v
        h = 0.5 * dt
        p = (px + dt * (vx + h * ax), py + dt * (vy + h * ay), pz + dt * (vz + h * az))
        return NavState(t_ns, p, (vx + dt * ax, vy + dt * ay, vz + dt * az), q), force

    def _rate_radps(self, w: Sequence[float]) -> tuple[float, float, float]:
        """Return the vehicle's rate by a row of the gyro."""
        bg, k = self.gyro_bias, self.gyro_scale
        return (w[0] - bg[0]) * (1.0 + k[0]), (w[1] - bg[1]) * (1.0 + k[1]), (w[2] - bg[2]) * (1.0 + k[2])

    def _propagate(
        self,
        T: float,
        force_W: np.ndarray,
        turn_B: np.ndarray,
        coasted_s: float,
        braked_s: float,
        tilt_variance: float,
    ) -> None:
        """Propagate the covariance over T seconds with the mean specific force.

        `turn_B`: angles by the gyro about the axes of B [rad]; `coasted_s`: seconds of T without rows; `braked_s`:
        seconds of those after the reaction time; `tilt_variance`: growth of the variance of roll and pitch in the gap.
        """
        if T <= 0.0:
            return
        felt_s = T - coasted_s
        F = np.eye(self._count)
        R = self.R
        F[P, V] = T * np.eye(3)
        F[V, V] *= math.exp(-braked_s / _STOP_S)
        F[V, TH] = -felt_s * skew(force_W)
        F[P, TH] = -0.5 * T * felt_s * skew(force_W)
        F[V, BA] = -felt_s * R
        F[TH, BG] = -felt_s * R
        if self._count > K_G.start:
            F[TH, K_G] = R * turn_B
        noise = np.zeros(self._count)
        noise[V] = T * _ACCEL_MPS_PER_RTS**2 + coasted_s * _COAST_MPS_PER_RTS**2
        noise[P] = noise[V] * T * T / 3.0
        noise[TH] = T * _GYRO_RAD_PER_RTS**2
        noise[8] += coasted_s * _COAST_RAD_PER_RTS**2
        left = math.exp(-braked_s / _LEVEL_S)
        F[6, 6] = F[7, 7] = left
        noise[6:8] += tilt_variance + (1.0 - left * left) * np.minimum(np.diag(self.cov)[6:8], _TILT_RAD**2)
        noise[BG], noise[BA] = T * _GYRO_WALK**2, T * _ACCEL_WALK**2
        self.cov = F @ self.cov @ F.T + np.diag(noise)

    def _tilt_growth(self, gap_s: float) -> float:
        """Return the growth of the variance of roll and pitch over further seconds of a gap."""
        before, self._silent_s = self._silent_s, self._silent_s + gap_s
        return min(_SPIN_RADPS * self._silent_s, _TILT_RAD) ** 2 - min(_SPIN_RADPS * before, _TILT_RAD) ** 2

    def _apply(self, error: np.ndarray) -> None:
        shift_p, shift_v = error[P], error[V]
        self.p = self.p + shift_p
        self.v = self.v + shift_v
        turn = turned((1.0, 0.0, 0.0, 0.0), *error[TH].tolist())
        self.q = product(turn, self.q)
        self.gyro_bias = self.gyro_bias + error[BG]
        self.accel_bias = self.accel_bias + error[BA]
        if self._count > K_G.start:
            self.gyro_scale = self.gyro_scale + error[K_G]
        # The newest recorded state is corrected too, so that the next sweep's motion correction contains no jump.
        if self._past:
            self._past[-1] = self.state()


def _silent(row_ns: int | None, t_ns: int) -> bool:
    """Return True if the gap since the last row is longer than `GAP_S`."""
    return row_ns is None or (t_ns - row_ns) * 1e-9 > GAP_S


def _coasted(m: NavState, to_ns: int, row_ns: int | None) -> NavState:
    """Continue a state without rows by the model of a gap; `row_ns`: time of the last row."""
    dt = (to_ns - m.t_ns) * 1e-9
    brakes_s = _brakes_s(dt, row_ns, to_ns)
    free_s = dt - brakes_s
    tilt, speed = math.exp(-brakes_s / _LEVEL_S), math.exp(-brakes_s / _STOP_S)
    way_s = free_s + _STOP_S * (1.0 - speed)
    p = (m.p[0] + way_s * m.v[0], m.p[1] + way_s * m.v[1], m.p[2] + way_s * m.v[2])
    q = m.q
    if brakes_s > 0.0:
        roll, pitch, yaw = roll_pitch_yaw(matrix_of(q))
        q = quaternion_of(tilt * roll, tilt * pitch, yaw)
    return NavState(to_ns, p, (speed * m.v[0], speed * m.v[1], speed * m.v[2]), q)


def _brakes_s(dt: float, row_ns: int | None, to_ns: int) -> float:
    """Return the part of the last `dt` seconds of a gap that lies after the vehicle's reaction time."""
    silent_s = dt if row_ns is None else (to_ns - row_ns) * 1e-9
    return min(dt, max(0.0, silent_s - _REACTION_S))
