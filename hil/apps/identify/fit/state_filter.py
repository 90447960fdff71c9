"""State of a vehicle in flight from what was measured up to an instant: an extended Kalman filter on the fitted model.

State [p, q, v, w, (O), a_W, b_B] of flight_model.py and the motors' delay d. a and b, which the model does not explain,
decay to zero with a time constant and are driven by white noise, so that a bias of the centre of mass, of the thrust
or of the wind is learnt while the vehicle flies; d is a slow random walk, because it differs from log to log.

A flying vehicle is stabilised: its autopilot turns against every rate, and what the model mistakes for torque (noise of
the telemetry, turbulence, errors of the model) does not carry it off. Integration of torques alone knows nothing of
that. A prediction therefore has
    dw = g torque / I - lambda w
With exact torques g is 1 and lambda 0. Both are learnt over past spans of `SPAN_S`, by least squares that forget in
`memory_s`, with D the torques' integral over the span:
    w(t) - w(t - span) = g D - l w(t - span) + noise,  exp(-lambda span) = 1 - l
Roll and pitch have at least the weight that the rms s of their rates in the past seconds gives them,
    g = s^2 / (s^2 + doubt^2),  lambda = min(fastest, stray / s)
Wiener's weight of a signal of size s in noise, and the leak of an integral of noise that long.

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
from hil.apps.identify.fit.integration import rates

Array = NDArray[np.float64]

SPAN_S = 0.5
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
    delay_s: float = 0.008  # of the first guess of d: deviation of the delays that the filter finds in eight flights
    delay_walk: float = 0.0003  # s per root second
    # Of roll and pitch: most likely in predictions of 0.5 s of flights slow and fast (docs/identify-model.md).
    doubt: float = 1.2  # rad/s
    stray: float = 1.3  # rad/s2
    fastest_per_s: float = 20.0
    rate_memory_s: float = 3.0
    memory_s: float = 10.0
    first_g: float = 0.4
    first_l: float = 0.5
    first_weight: float = 0.4  # (rad/s)^2 of the first guess


class Track(NamedTuple):
    """Filtered states [instants, states, logs]; delays, rho [instants, logs]; lambda, g [instants, 3, logs]."""

    z: Array
    delay_s: Array
    decay_per_s: Array
    trust: Array
    rho: Array


class _Weights:
    """Least squares of g and l, for each axis [3, L]."""

    def __init__(self, noise: FilterNoise, logs: int) -> None:
        self._first = noise.first_weight
        self._guess = noise.first_g, noise.first_l
        self._dd, self._dw, self._ww, self._da, self._wa = (np.zeros((3, logs)) for _ in range(5))

    def add(self, change: Array, model: Array, before: Array, forget: float, known: NDArray[np.bool_]) -> None:
        """Take one span's change of rate, what the model's torques give, and the rate at its start."""
        h = 0.01 * known  # spans overlap: a second's count as one
        for total, product in (
            (self._dd, model * model),
            (self._dw, -model * before),
            (self._ww, before * before),
            (self._da, model * change),
            (self._wa, -before * change),
        ):
            total *= forget
            total += h * product

    def solve(self) -> tuple[Array, Array]:
        """Return g from 0 to 1 and lambda from 0 [1/s]."""
        g0, l0 = self._guess
        dd, ww = self._dd + self._first, self._ww + self._first
        da, wa = self._da + self._first * g0, self._wa + self._first * l0
        det = dd * ww - self._dw * self._dw
        g = np.clip((da * ww - wa * self._dw) / det, 0.0, 1.0)
        loss = np.clip((wa * dd - da * self._dw) / det, 0.0, 0.98)
        return g, -np.log(1.0 - loss) / SPAN_S


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
    turned, biased, learnt = np.zeros((n + 1, 3, L)), np.zeros((n, 3, L)), _Weights(noise, L)
    forget = np.exp(-h / noise.memory_s)
    turning2 = np.full(L, 0.2)
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
            gained = turned[k] - turned[k - span] + SPAN_S * biased[k - span]
            learnt.add(zs[k, 10:13] - zs[k - span, 10:13], gained, zs[k - span, 10:13], forget, known[k])
        trusts[k], decays[k] = learnt.solve()
        turning2 += h / noise.rate_memory_s * (0.5 * (z[10] ** 2 + z[11] ** 2) - turning2)
        least = turning2 / (turning2 + noise.doubt**2)
        below = trusts[k, :2] < least
        decays[k, :2] = np.where(below, np.minimum(noise.fastest_per_s, noise.stray / np.sqrt(turning2)), decays[k, :2])
        trusts[k, :2] = np.maximum(trusts[k, :2], least)
        S[where] = d
        value, A, B = rates(model.rates[0], z, S, inputs[k])
        slope = value.T
        biased[k] = z[nz - 3 :]
        turned[k + 1] = turned[k] + h * (slope[10:13] - biased[k])
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
