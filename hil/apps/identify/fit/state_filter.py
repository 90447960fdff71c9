"""State of a vehicle in flight from what was measured up to an instant: an extended Kalman filter on the fitted model.

State [p, q, v, w, (O), a_W, b_B] of flight_model.py and the motors' delay d. a and b, which the model does not explain,
decay to zero with a time constant and are driven by white noise, so that a bias of the centre of mass, of the thrust
or of the wind is learnt while the vehicle flies; d is a slow random walk, because it differs from log to log.

A flying vehicle is stabilised: its autopilot turns against every rate, and what the model mistakes for torque (noise of
the telemetry, turbulence, errors of the model) does not carry it off. Integration of torques alone knows nothing of
that. A prediction therefore has
    dw = g torque / I - lambda w
With exact torques g is 1 and lambda 0. Both are learnt, for each axis, from past spans of `SPAN_S` as the most likely
ones in this very prediction of rate and angle, with white noise of the torque and a memory of `memory_s`:
    r = w(t) - e^(-lambda T) w(t - T) - g S,         S integral of e^(-lambda (t - s)) torque / I ds over the span T
    a = angle of the span - E w(t - T) - g (P - S) / lambda,   P with lambda = 0,   E = (1 - e^(-lambda T)) / lambda
    sum of 4 r^2 / T - 12 r a / T^2 + 12 a^2 / T^3 least
For each lambda of `LEAKS_PER_S` the least squares give g; the lambda with the least of them is taken.

Velocities of some logs are larger than the change of their positions (optical flow: a wrong height, a wrong lens). The
ratio rho of the two, level, is learnt from the past, and positions advance by rho v.

Several logs are filtered side by side, one column each: the cost of an instant is mostly that of its call.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import FlightModel
from hil.apps.identify.fit.shooting import rates

Array = NDArray[np.float64]

SPAN_S = 0.5
LEAKS_PER_S = (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0)
_SPAN = 10  # instants over which positions are compared with velocities


@dataclass(frozen=True)
class FilterNoise:
    """Deviations [SI]: white accelerations (per root second), unexplained accelerations, readings."""

    move: float = 0.02  # m/s sqrt(s)
    lean: float = 0.01  # rad/s sqrt(s)
    turn: float = 2.0  # rad/s2 sqrt(s)
    yaw: float = 0.1  # of that about z, where torques are smaller
    turn_bias: float = 1.5  # rad/s2, of b
    turn_bias_s: float = 60.0
    first_bias: float = 8.0  # of b before anything is known
    push: float = 0.1  # m/s2 sqrt(s)
    push_bias: float = 1.0
    push_bias_s: float = 5.0
    rate: float = 0.04
    position: float = 0.002
    attitude: float = 0.003
    velocity: float = 0.01
    delay_s: float = 0.008  # of the first guess of d
    delay_walk: float = 0.0003  # s per root second
    memory_s: float = 10.0
    first_weight: float = 0.4  # (rad/s)^2 of the first guess, which is g = 1 and lambda = 0


class Track(NamedTuple):
    """Filtered states [instants, states, logs]; delays, rho [instants, logs]; lambda, g [instants, 3, logs]."""

    z: Array
    delay_s: Array
    decay_per_s: Array
    trust: Array
    rho: Array


class _Weights:
    """Likelihood of each leak, with the most likely g for it, for each axis: [leaks, 3, L]."""

    def __init__(self, noise: FilterNoise, logs: int, step_s: float) -> None:
        self._h, self._first = step_s, noise.first_weight
        self._leaks = np.array(LEAKS_PER_S)[:, None, None]
        self._left = np.exp(-self._leaks * SPAN_S)
        self._mean_s = (1.0 - self._left) / self._leaks  # E
        shape = (len(LEAKS_PER_S), 3, logs)
        self._leaky, self._plain = np.zeros(shape), np.zeros((3, logs))  # S, P
        self._angle = np.zeros((3, logs))
        self._xx, self._xy, self._yy = np.zeros(shape), np.zeros(shape), np.zeros(shape)

    def integrate(self, torque: Array, rate: Array, torque_gone: Array, rate_gone: Array) -> None:
        """Add torque over inertia and rate [3, L] of one step, and take out those that the span leaves behind."""
        h = self._h
        self._leaky = np.exp(-self._leaks * h) * (self._leaky + h * torque) - self._left * h * torque_gone
        self._plain = self._plain + h * (torque - torque_gone)
        self._angle = self._angle + h * (rate - rate_gone)

    def compare(self, now: Array, before: Array, bias: Array, forget: float, known: NDArray[np.bool_]) -> None:
        """Take one span: rates at its end and start, and the unexplained acceleration that was known at its start."""
        x_r = self._leaky + self._mean_s * bias
        x_a = (self._plain - self._leaky + (SPAN_S - self._mean_s) * bias) / self._leaks
        y_r, y_a = now - self._left * before, self._angle - self._mean_s * before
        weight = self._h * known  # spans overlap: a second's count as one
        for total, product in (
            (self._xx, _white(x_r, x_a, x_r, x_a)),
            (self._xy, _white(x_r, x_a, y_r, y_a)),
            (self._yy, _white(y_r, y_a, y_r, y_a)),
        ):
            total *= forget
            total += weight * product

    def solve(self) -> tuple[Array, Array]:
        """Return g from 0 to 1 and lambda [1/s], [3, L]."""
        first = self._first
        g = np.clip((self._xy + first) / (self._xx + first), 0.0, 1.0)
        squares = self._yy - 2.0 * g * self._xy + g * g * self._xx + first * ((1.0 - g) ** 2 + (1.0 - self._left) ** 2)
        best = np.argmin(squares, axis=0)[None]
        return np.take_along_axis(g, best, axis=0)[0], np.array(LEAKS_PER_S)[best[0]]


def _white(r1: Array, a1: Array, r2: Array, a2: Array) -> Array:
    """Return the product of two pairs of rate and angle in the metric of white torque over a span."""
    T = SPAN_S
    return 4.0 / T * r1 * r2 - 6.0 / T**2 * (r1 * a2 + a1 * r2) + 12.0 / T**3 * a1 * a2


def track(
    model: FlightModel, s: Array, inputs: Array, measured: Array, known: NDArray[np.bool_],
    *, pose_delay_s: float, first_delay_s: float, noise: FilterNoise,
) -> Track:  # fmt: skip
    """Filter logs on a common grid.

    `s` of vehicle and log with both delays 0; `inputs` [n, inputs, L] of the motors at delay `first_delay_s`;
    `measured` [n, 13, L] = p, q, v, w; `known` [n, L]: where a log has begun and not ended.
    """
    n, _, L = inputs.shape
    nz, h = model.states, model.step_s
    N = nz + 1
    z = np.zeros((nz, L))
    z[:13] = measured[0]
    d = np.zeros(L)  # beyond first_delay_s
    P = np.zeros((L, N, N))
    start = np.r_[np.full(3, noise.position), np.full(4, noise.attitude), np.full(3, noise.velocity * 3),
                  np.full(3, noise.rate), np.full(nz - 19, 100.0), np.full(3, noise.push_bias),
                  np.full(3, noise.first_bias), noise.delay_s]  # fmt: skip
    P[:, np.arange(N), np.arange(N)] = start**2
    keep_a, keep_b = np.exp(-h / noise.push_bias_s), np.exp(-h / noise.turn_bias_s)
    Q = np.zeros(N)
    Q[fm.P], Q[fm.Q] = noise.move**2 * h, (0.5 * noise.lean) ** 2 * h
    Q[fm.V], Q[fm.W] = noise.push**2 * h, (noise.turn * np.array([1.0, 1.0, noise.yaw])) ** 2 * h
    Q[nz - 6 : nz - 3], Q[nz - 3 : nz] = noise.push_bias**2 * (1 - keep_a**2), noise.turn_bias**2 * (1 - keep_b**2)
    Q[nz] = noise.delay_walk**2 * h
    if model.kind == "command":
        Q[fm.O : fm.O + model.rotors] = 50.0**2 * h
    R = np.r_[np.full(3, noise.position), np.full(4, noise.attitude / 2), np.full(3, noise.velocity),
              np.full(3, noise.rate)] ** 2  # fmt: skip
    S = np.repeat(s[:, None], L, axis=1)
    where = at.VEHICLE_COUNT + at.MOTOR_DELAY
    zs, ds = np.zeros((n, nz, L)), np.zeros((n, L))
    step = model.step.map(L)
    H = np.zeros((13, N))
    H[np.arange(13), np.arange(13)] = 1.0
    H[fm.P, fm.V] = -pose_delay_s * np.eye(3)
    eye = np.eye(N)
    rho, rhos, s1, s2 = np.ones(L), np.ones((n, L)), np.full(L, 0.5), np.full(L, 0.5)
    decays, trusts = np.zeros((n, 3, L)), np.ones((n, 3, L))
    span = round(SPAN_S / h)
    torques, biased, learnt = np.zeros((n, 3, L)), np.zeros((n, 3, L)), _Weights(noise, L, h)
    forget = np.exp(-h / noise.memory_s)
    slope = np.zeros((nz, L))
    for k in range(n):
        y = measured[k].copy()
        flip = np.sign((y[fm.Q] * z[fm.Q]).sum(axis=0))
        y[fm.Q] *= np.where(flip == 0, 1, flip)
        expected = z[:13] - pose_delay_s * np.r_[slope[:10], np.zeros((3, L))]
        e = y - expected
        PH = P @ H.T
        K = PH @ np.linalg.inv(H @ PH + np.diag(R))
        K[~known[k]] = 0.0
        gain = (K @ e.T[:, :, None])[:, :, 0].T
        z = z + gain[:nz]
        d = d + gain[nz]
        z[fm.Q] /= np.linalg.norm(z[fm.Q], axis=0)
        P = (eye - K @ H) @ P
        P = 0.5 * (P + P.transpose(0, 2, 1))
        zs[k], ds[k] = z, first_delay_s + d
        if k >= _SPAN:
            went = measured[k, :2] - measured[k - _SPAN, :2]
            said = h * measured[k - _SPAN : k, 7:9].sum(axis=0)
            s1, s2 = s1 + (went * said).sum(axis=0), s2 + (said * said).sum(axis=0)
            rho = s1 / s2
        rhos[k] = rho
        if k > span:
            learnt.compare(zs[k, 10:13], zs[k - span, 10:13], biased[k - span], forget, known[k])
        trusts[k], decays[k] = learnt.solve()
        S[where] = d
        value, A, B = rates(model.rates[0], z, S, inputs[k])
        slope = value.T
        biased[k] = z[nz - 3 :]
        torques[k] = slope[10:13] - biased[k]
        old = k >= span
        learnt.integrate(
            torques[k],
            zs[k, 10:13],
            torques[k - span] if old else np.zeros((3, L)),
            zs[k - span, 10:13] if old else np.zeros((3, L)),
        )
        F = np.zeros((L, N, N))
        hA = h * A
        F[:, :nz, :nz] = np.eye(nz) + hA + 0.5 * hA @ hA
        F[:, :nz, nz] = h * B[:, :, where] + 0.5 * h * (hA @ B[:, :, where : where + 1])[:, :, 0]
        F[:, nz, nz] = 1.0
        F[:, nz - 6 : nz - 3] *= keep_a
        F[:, nz - 3 : nz] *= keep_b
        ended = ~known[k]
        kept_z, kept_P = z[:, ended], P[ended]
        p0 = z[:2]
        z = step(z, S, inputs[k]).full()
        z[:2] = p0 + rho * (z[:2] - p0)
        z[nz - 6 : nz - 3] *= keep_a
        z[nz - 3 : nz] *= keep_b
        P = F @ P @ F.transpose(0, 2, 1)
        P[:, np.arange(N), np.arange(N)] += Q
        z[:, ended], P[ended] = kept_z, kept_P
    return Track(zs, ds, decays, trusts, rhos)
