"""Maximum likelihood by multiple shooting, with the states at the windows' starts eliminated.

    J = 1/2 sum over windows, instants, sensors of |y - g(z_k, theta)|^2 / sigma^2
      + 1/2 sum over windows of (z_0 - m)' M (z_0 - m)  +  1/2 sum |theta / prior|^2
Gauss-Newton with Levenberg's damping. A window's start z_0 touches that window alone, so its block is eliminated
(Schur complement) and what is left is as small as theta. Deviations sigma of the sensors, and of the accelerations
that the model does not explain, are estimated along (the fixed point of their own likelihood).

Covariance of theta: A^-1 B A^-1 with A the information and B the sum over blocks of consecutive windows of the outer
products of their scores (White's sandwich, clustered): residuals of flights are coloured, and A^-1 alone claims more
than there is. How long they stay alike is not known (turbulence: a minute), so blocks of `_CLUSTERS` windows are tried,
as long as there are `_LEAST_CLUSTERS` of them. A deviation from few blocks is itself uncertain: it is widened by what
Student's t needs for the share of a normal variable within 3 sigma. The largest deviation is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp
from scipy.special import stdtrit

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import FlightModel
from hil.apps.identify.fit.integration import Step, between, rates
from hil.apps.identify.fit.windows import Windows

Array = NDArray[np.float64]

# Start values of sensor deviations [rad/s, m/s2, m, rad, m/s], and the least that is believed.
START_SIGMA = np.repeat([0.2, 1.0, 0.02, 0.03, 0.1], 3)
_LEAST = np.repeat([1e-4, 1e-3, 1e-4, 1e-4, 1e-3], 3)
_UNEXPLAINED = np.array([0.3, 0.3, 0.3, 2.0, 2.0, 2.0])  # start of the deviations of a_W and b_B
_LEAST_UNEXPLAINED = np.array([0.003, 0.003, 0.003, 0.01, 0.01, 0.01])
_CLUSTERS, _LEAST_CLUSTERS = (4, 8, 16, 32), 8
_WITHIN_3_SIGMA = 0.5 * (1.0 + 0.9973002)  # quantile at 3 sigma
_CHUNK = 32  # windows that one thread takes at a time
_POSE_SERIES = 2  # and the later ones share the delay of the pose
_SETTLED = 0.05  # a step below this share of every deviation ends the iteration


@dataclass
class Group:
    """Windows of one log with what the fit keeps for them."""

    windows: Windows
    z0: Array  # [states, W]
    prior_mean: Array
    prior_weight: Array  # diagonal of M [states, W]
    sigma: Array = field(default_factory=lambda: START_SIGMA.copy())


@dataclass
class Sums:
    """Normal equations of one log's windows, each window by itself: totals are made in the order of the windows."""

    costs: Array  # [W]
    Hzz: Array  # [W, nz, nz]
    Hzs: Array  # [W, nz, ns]
    Hss: Array  # [W, ns, ns]
    gz: Array
    gs: Array
    squares: Array  # of residuals by output [W, OUTPUTS]
    counts: Array

    @property
    def cost(self) -> float:
        return float(self.costs.sum())

    @staticmethod
    def of(parts: Sequence[Sums]) -> Sums:
        return Sums(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(Sums)))


def sums(model: FlightModel, group: Group, s: Array, workers: Executor | None = None) -> Sums:
    """Return cost and normal equations at theta's part `s` (vehicle, then this log).

    The windows are split into chunks, which `workers` share. A window's numbers are the same in any chunk and thread.
    """
    w = group.windows
    u, readings = w.inputs(), w.readings(*s[at.VEHICLE_COUNT + np.array([at.MOTOR_DELAY, at.POSE_DELAY])])
    chunks = [slice(first, first + _CHUNK) for first in range(0, w.count, _CHUNK)]

    def part(chunk: slice) -> Sums:
        y, q, share = (np.ascontiguousarray(x[:, :, chunk]) for x in readings)
        return _sums(model, group, chunk, s, u=np.ascontiguousarray(u[:, :, chunk]), y=y, q=q, share=share)

    return Sums.of(list(workers.map(part, chunks) if workers is not None else map(part, chunks)))


def _sums(
    model: FlightModel, group: Group, chunk: slice, s: Array, *, u: Array, y: Array, q: Array, share: Array
) -> Sums:  # fmt: skip
    """`y`, `q`, `share`, `u` as of the chunk [steps, rows, W]."""
    nz, ns, theta = model.states, len(s), s[:, None].copy()
    theta[at.VEHICLE_COUNT + at.MOTOR_DELAY] = 0.0  # it is in the times of the readings
    z = np.ascontiguousarray(group.z0[:, chunk])
    W = z.shape[1]
    S = np.zeros((W, nz, nz + ns))  # of the state to the window's start and to s, side by side
    S[:, :, :nz] = np.eye(nz)
    off, M = z - group.prior_mean[:, chunk], group.prior_weight[:, chunk]
    H, g = np.zeros((W, nz + ns, nz + ns)), np.zeros((W, nz + ns))
    costs = 0.5 * (M * off * off).sum(axis=0)
    H[:, np.arange(nz), np.arange(nz)] += M.T
    g[:, :nz] += (M * off).T
    q0 = z[fm.Q].T
    H[:, fm.Q, fm.Q] += 1e4 * q0[:, :, None] * q0[:, None, :]
    squares, counts = np.zeros((W, fm.OUTPUTS)), np.zeros((W, fm.OUTPUTS))
    log_sigma = np.log(group.sigma)
    step = Step(model, W)
    motor_delay, pose_delay = nz + at.VEHICLE_COUNT + at.MOTOR_DELAY, nz + at.VEHICLE_COUNT + at.POSE_DELAY
    for k in range(len(u)):
        step.start(z, theta, u[k])
        for reading in model.readings:
            outputs = reading.outputs
            known = np.isfinite(y[k, outputs].T)
            if not known.any():
                continue
            there = step.within(share[k, reading.series], reading.states)
            motors = between(u[k], share[k, reading.series], model.rotors, model.step_s)
            value, gz, gs = rates(reading.function, there.z, theta, motors, q[k])
            r = np.where(known, value - np.nan_to_num(y[k, outputs].T), 0.0) / group.sigma[outputs]
            gz = gz[:, :, reading.states]
            G = (gz @ there.F) @ S
            G[:, :, nz:] += gs + gz @ there.B
            by_time = (gz @ there.slope[:, :, None])[:, :, 0]
            G[:, :, motor_delay] += by_time
            if reading.series >= _POSE_SERIES:
                G[:, :, pose_delay] -= by_time
            G *= (known / group.sigma[outputs])[:, :, None]
            GT = G.transpose(0, 2, 1)
            costs += 0.5 * (r * r).sum(axis=1) + known @ log_sigma[outputs]
            H += GT @ G
            g += (GT @ r[:, :, None])[:, :, 0]
            squares[:, outputs] += (r * r) * group.sigma[outputs] ** 2
            counts[:, outputs] += known
        if k + 1 < len(u):
            z, F, B = step.end()
            S = F @ S
            S[:, :, nz:] += B
    return Sums(costs, H[:, :nz, :nz], H[:, :nz, nz:], H[:, nz:, nz:], g[:, :nz], g[:, nz:], squares, counts)


def first_states(model: FlightModel, windows: Windows, motor_delay_s: float = 0.0) -> Group:
    """Return the windows with their states at the start as measured."""
    log, t = windows.log, windows.starts_s - motor_delay_s
    if log.pose is None:
        raise ValueError(f"{log.name}: a fit needs poses")
    z = np.zeros((model.states, windows.count))
    pose = log.pose
    for i in range(3):
        z[i] = np.interp(t, pose.t_s, pose.values[:, i])
        if log.velocity is not None:
            z[7 + i] = np.interp(t, log.velocity.t_s, log.velocity.values[:, i])
        else:
            z[7 + i] = np.interp(t, pose.t_s, np.gradient(pose.values[:, i], pose.t_s))
        if log.rate is not None:
            z[10 + i] = np.interp(t, log.rate.t_s, log.rate.values[:, i])
    turns = Slerp(pose.t_s, Rotation.from_quat(pose.values[:, [4, 5, 6, 3]]))
    q = turns(np.clip(t, pose.t_s[0], pose.t_s[-1])).as_quat()
    z[fm.Q] = q[:, [3, 0, 1, 2]].T
    weight = np.zeros_like(z)
    weight[:3], weight[fm.V], weight[fm.W], weight[fm.Q] = 1e-2, 1e-2, 1e-2, 1e-2
    if model.kind == "command":
        n = model.rotors
        z[fm.O : fm.O + n] = 1.0
        weight[fm.O : fm.O + n] = 1.0
    return Group(windows, z, z.copy(), weight)


@dataclass
class Solution:
    """Vector theta [vehicle, log 0, log 1 ...] with its covariance, and the groups at the optimum."""

    s: Array
    covariance: Array
    information: Array
    groups: list[Group]
    cost: float
    unexplained: Array


def _part(number: int) -> NDArray[np.int64]:
    first = at.VEHICLE_COUNT + number * at.LOG_COUNT
    return np.r_[np.arange(at.VEHICLE_COUNT), np.arange(first, first + at.LOG_COUNT)]


@dataclass(frozen=True)
class Guess:
    """Theta to begin with, its deviations beforehand, which of it is free, and the accelerations left unexplained."""

    s: Array
    priors: Array
    free: NDArray[np.bool_]
    unexplained: Array | None = None


def solve(
    model: FlightModel,
    groups: list[Group],
    guess: Guess,
    *,
    steady: Callable[[Group, Array], Array] | None,
    progress: Callable[[float, str], None],
    most: int = 15,
    workers: Executor | None = None,
) -> Solution:
    """Return the most likely theta. `steady` gives the rotor speeds that the windows' first commands lead to.

    `workers` are threads, which change no bit of it. `progress` is told the share done, 0 to 1, and what is done.
    """
    s, damping = guess.s.copy(), 1e-4
    priors, free = guess.priors, guess.free
    wander = _UNEXPLAINED.copy() if guess.unexplained is None else guess.unexplained.copy()
    prior_weight = 1.0 / priors**2

    def set_priors() -> None:
        means = np.array([g.z0[-6:].mean(axis=1) for g in groups])
        for g, mean in zip(groups, means - means.mean(axis=0), strict=True):  # a battery's place, say, of one log
            g.prior_weight[-6:] = 1.0 / wander[:, None] ** 2
            g.prior_mean[-6:] = mean[:, None]
            if steady is not None:
                speeds = steady(g, s[_part(g.windows.number)])
                g.prior_mean[fm.O : fm.O + model.rotors] = speeds
                g.prior_weight[fm.O : fm.O + model.rotors] = 1.0 / (0.15 * np.abs(speeds).mean() + 1.0) ** 2

    set_priors()
    if steady is not None:
        for g in groups:
            g.z0[fm.O : fm.O + model.rotors] = g.prior_mean[fm.O : fm.O + model.rotors]

    def total(parts: Sequence[Sums], s: Array) -> float:
        return sum(p.cost for p in parts) + 0.5 * float((prior_weight * s * s).sum())

    parts = [sums(model, g, s[_part(g.windows.number)], workers) for g in groups]
    cost = total(parts, s)
    n = len(s)
    for iteration in range(1, most + 1):
        progress(iteration / (most + 1), f"iteration {iteration}")
        A, b, inner = np.diag(prior_weight), prior_weight * s, []
        for g, p in zip(groups, parts, strict=True):
            where = _part(g.windows.number)
            inverse = np.linalg.inv(p.Hzz + damping * np.einsum("wii->wi", p.Hzz)[:, :, None] * np.eye(model.states))
            gain = inverse @ p.Hzs
            A[np.ix_(where, where)] += (p.Hss - p.Hzs.transpose(0, 2, 1) @ gain).sum(axis=0)
            b[where] += (p.gs - (gain.transpose(0, 2, 1) @ p.gz[:, :, None])[:, :, 0]).sum(axis=0)
            inner.append((inverse, gain))
        D = A[np.ix_(free, free)]
        step = np.zeros(n)
        step[free] = -np.linalg.solve(D + damping * np.diag(np.diag(D)), b[free])
        step = np.clip(step, -0.7 * priors, 0.7 * priors)
        kept = [g.z0 for g in groups]
        for g, p, (inverse, gain) in zip(groups, parts, inner, strict=True):
            ds = step[_part(g.windows.number)]
            dz = -(inverse @ p.gz[:, :, None])[:, :, 0] - gain @ ds
            z = g.z0 + dz.T
            z[fm.Q] /= np.linalg.norm(z[fm.Q], axis=0)
            if model.kind == "command":
                z[fm.O : fm.O + model.rotors] = np.maximum(z[fm.O : fm.O + model.rotors], 0.0)
            g.z0 = z
        new = s + step
        trial = [sums(model, g, new[_part(g.windows.number)], workers) for g in groups]
        new_cost = total(trial, new)
        if not np.isfinite(new_cost) or new_cost > cost + 1e-9 * abs(cost):
            for g, z in zip(groups, kept, strict=True):
                g.z0 = z
            damping = max(damping * 10, 1e-4)
            if damping > 1e6:
                break
            continue
        s, parts, cost = new, trial, new_cost
        damping = max(damping * 0.2, 1e-9)
        deviation = np.sqrt(np.diag(np.linalg.inv(D)))
        moved = float(np.max(np.abs(step[free]) / deviation))
        # Deviations of the sensors and of the unexplained accelerations, for the next step.
        changed = 0.0
        explained, spread, windows = np.zeros(6), np.zeros(6), 0
        # One deviation for all logs: a wild flight has larger errors, of the model, and must not count less for it.
        squares, counts = sum(p.squares.sum(axis=0) for p in parts), sum(p.counts.sum(axis=0) for p in parts)
        rms = np.maximum(np.sqrt(squares / np.maximum(counts, 1)), _LEAST)
        for g, p in zip(groups, parts, strict=True):
            new_sigma = np.clip(np.where(counts > 0, rms, g.sigma), 0.2 * g.sigma, 5 * g.sigma)
            changed = max(changed, float(np.max(np.abs(np.log(new_sigma / g.sigma)))))
            g.sigma = new_sigma
            explained += ((g.z0[-6:] - g.prior_mean[-6:]) ** 2).sum(axis=1)
            spread += np.einsum("wii->i", np.linalg.inv(p.Hzz)[:, -6:, -6:])
            windows += g.windows.count
        new_spread = np.maximum(np.sqrt((explained + spread) / windows), _LEAST_UNEXPLAINED)
        changed = max(changed, float(np.max(np.abs(np.log(new_spread / wander)))) / 3)
        wander = new_spread
        if moved < _SETTLED and changed < 0.05:
            break
        if changed >= 0.03:
            set_priors()
            parts = [sums(model, g, s[_part(g.windows.number)], workers) for g in groups]
            cost = total(parts, s)
    return _with_covariance(groups, parts, s, prior_weight, free, cost, wander)


def _with_covariance(
    groups: list[Group], parts: list[Sums], s: Array, prior_weight: Array,
    free: NDArray[np.bool_], cost: float, unexplained: Array,
) -> Solution:  # fmt: skip
    n = len(s)
    A, scores = np.diag(prior_weight), []
    for g, p in zip(groups, parts, strict=True):
        where = _part(g.windows.number)
        gain = np.linalg.inv(p.Hzz) @ p.Hzs
        A[np.ix_(where, where)] += (p.Hss - p.Hzs.transpose(0, 2, 1) @ gain).sum(axis=0)
        score = np.zeros((g.windows.count, n))
        score[:, where] = p.gs - (gain.transpose(0, 2, 1) @ p.gz[:, :, None])[:, :, 0]
        scores.append(score)
    inverse = np.zeros((n, n))
    inverse[np.ix_(free, free)] = np.linalg.inv(A[np.ix_(free, free)])
    variance = np.diag(inverse).copy()
    covariance = inverse
    for length in _CLUSTERS:
        blocks = np.concatenate([np.add.reduceat(x, np.arange(0, len(x), length)) for x in scores if len(x)])
        if length > _CLUSTERS[0] and len(blocks) < _LEAST_CLUSTERS:
            break
        blocks *= stdtrit(max(len(blocks) - 1, 1), _WITHIN_3_SIGMA) / 3.0
        robust = inverse @ (np.diag(prior_weight) + blocks.T @ blocks) @ inverse
        if length == _CLUSTERS[0]:
            covariance = robust
        variance = np.maximum(variance, np.diag(robust))
    scale = np.sqrt(np.maximum(1.0, variance / np.maximum(np.diag(covariance), 1e-300)))
    covariance = covariance * scale[:, None] * scale[None, :]
    return Solution(s, covariance, A, groups, cost, unexplained)
