"""Maximum likelihood by multiple shooting, with the states at the windows' starts eliminated.

    J = 1/2 sum over windows, instants, sensors of |y - g(z_k, theta)|^2 / sigma^2
      + 1/2 sum over windows of (z_0 - m)' M (z_0 - m)  +  1/2 sum |theta / prior|^2
Gauss-Newton with Levenberg's damping. A window's start z_0 touches that window alone, so its block is eliminated
(Schur complement) and what is left is as small as theta. Deviations sigma of the sensors, and of the accelerations
that the model does not explain, are estimated along (the fixed point of their own likelihood).

Covariance of theta: A^-1 B A^-1 with A the information and B the sum over blocks of consecutive windows of the outer
products of their scores (White's sandwich, clustered): residuals of flights are coloured, and A^-1 alone claims more
than there is. The larger of the two deviations is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import Differentiated, FlightModel
from hil.apps.identify.fit.windows import Windows

Array = NDArray[np.float64]

# Start values of sensor deviations [rad/s, m/s2, m, rad, m/s], and the least that is believed.
START_SIGMA = np.repeat([0.2, 1.0, 0.02, 0.03, 0.1], 3)
_LEAST = np.repeat([1e-4, 1e-3, 1e-4, 1e-4, 1e-3], 3)
_UNEXPLAINED = np.array([0.3, 0.3, 0.3, 2.0, 2.0, 2.0])  # start of the deviations of a_W and b_B
_LEAST_UNEXPLAINED = np.array([0.003, 0.003, 0.003, 0.01, 0.01, 0.01])
_CLUSTER = 4
_SETTLED = 0.05  # a step below this share of every deviation ends the iteration


@dataclass
class Group:
    """Windows of one log with what the fit keeps for them."""

    windows: Windows
    z0: Array  # [states, W]
    prior_mean: Array
    prior_weight: Array  # diagonal of M [states, W]
    sigma: Array = field(default_factory=lambda: START_SIGMA.copy())


def rates(f: Differentiated, *args: Array) -> tuple[Array, Array, Array]:
    """Return value [W, n], Jacobian to z [W, n, nz] and to s [W, n, ns] for columns of arguments."""
    W = args[0].shape[1]
    value, jz, js = (x.full() for x in f.function.map(W)(*args))
    A, B = np.zeros((W, f.shape[0], f.shape[1])), np.zeros((W, f.shape[0], f.shape[2]))
    A[:, f.by_z[0], f.by_z[1]] = jz.T
    B[:, f.by_s[0], f.by_s[1]] = js.T
    return value.T, A, B


def advance(model: FlightModel, z: Array, s: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return the state [W, nz] one step on and its Jacobians to z and s: the Runge-Kutta step, differentiated."""
    h = model.step_s
    k1, a1, b1 = rates(model.rates[0], z, s, u)
    k2, a2, b2 = rates(model.rates[1], z + 0.5 * h * k1.T, s, u)
    A2, B2 = a2 + 0.5 * h * a2 @ a1, b2 + 0.5 * h * a2 @ b1
    k3, a3, b3 = rates(model.rates[1], z + 0.5 * h * k2.T, s, u)
    A3, B3 = a3 + 0.5 * h * a3 @ A2, b3 + 0.5 * h * a3 @ B2
    k4, a4, b4 = rates(model.rates[2], z + h * k3.T, s, u)
    A4, B4 = a4 + h * a4 @ A3, b4 + h * a4 @ B3
    end = z.T + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    F = np.eye(model.states) + h / 6 * (a1 + 2 * A2 + 2 * A3 + A4)
    B = h / 6 * (b1 + 2 * B2 + 2 * B3 + B4)
    return end, F, B


@dataclass
class Sums:
    """Normal equations of one log's windows."""

    cost: float
    Hzz: Array  # [W, nz, nz]
    Hzs: Array  # [W, nz, ns]
    Hss: Array  # [W, ns, ns]
    gz: Array
    gs: Array
    squares: Array  # of residuals by output
    counts: Array


def sums(model: FlightModel, group: Group, s: Array) -> Sums:
    """Return cost and normal equations at theta's part `s` (vehicle, then this log)."""
    w, ns = group.windows, len(s)
    u_all = w.inputs(s[at.VEHICLE_COUNT + at.MOTOR_DELAY])
    y_all, q_all, dt_all = w.readings(s[at.VEHICLE_COUNT + at.POSE_DELAY])
    shifted = s.copy()
    shifted[at.VEHICLE_COUNT + at.MOTOR_DELAY] = shifted[at.VEHICLE_COUNT + at.POSE_DELAY] = 0.0
    S = np.repeat(shifted[:, None], w.count, axis=1)
    nz, W = model.states, w.count
    z = group.z0
    Sz, Ss = np.repeat(np.eye(nz)[None], W, axis=0), np.zeros((W, nz, ns))
    off = z - group.prior_mean
    M = group.prior_weight
    out = Sums(
        0.5 * float((M * off * off).sum()),
        np.zeros((W, nz, nz)), np.zeros((W, nz, ns)), np.zeros((W, ns, ns)), (M * off).T.copy(), np.zeros((W, ns)),
        np.zeros(fm.OUTPUTS), np.zeros(fm.OUTPUTS),
    )  # fmt: skip
    out.Hzz[:, np.arange(nz), np.arange(nz)] += M.T
    q0 = z[fm.Q].T
    out.Hzz[:, fm.Q, fm.Q] += 1e4 * q0[:, :, None] * q0[:, None, :]
    for k in range(w.steps):
        y, known = y_all[k].T, np.isfinite(y_all[k].T)
        if known.any():
            value, gz, gs = rates(model.read, z, S, u_all[k], q_all[k], dt_all[k])
            r = np.where(known, value - np.nan_to_num(y), 0.0) / group.sigma
            weight = known / group.sigma
            Gz = weight[:, :, None] * (gz @ Sz)
            Gs = weight[:, :, None] * (gs + gz @ Ss)
            out.cost += 0.5 * float((r * r).sum()) + float((known * np.log(group.sigma)).sum())
            GzT, GsT = Gz.transpose(0, 2, 1), Gs.transpose(0, 2, 1)
            out.Hzz += GzT @ Gz
            out.Hzs += GzT @ Gs
            out.Hss += GsT @ Gs
            out.gz += (GzT @ r[:, :, None])[:, :, 0]
            out.gs += (GsT @ r[:, :, None])[:, :, 0]
            out.squares += (r * r).sum(axis=0) * group.sigma**2
            out.counts += known.sum(axis=0)
        if k + 1 < w.steps:
            end, F, B = advance(model, z, S, u_all[k])
            z = end.T
            Ss = F @ Ss + B
            Sz = F @ Sz
    return out


def first_states(model: FlightModel, windows: Windows) -> Group:
    """Return the windows with their states at the start as measured."""
    log, t = windows.log, windows.starts_s
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
    iterations: int


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
) -> Solution:
    """Return the most likely theta. `steady` gives the rotor speeds that the windows' first commands lead to.

    `progress` is told the share done, 0 to 1, and what is done.
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

    parts = [sums(model, g, s[_part(g.windows.number)]) for g in groups]
    cost = total(parts, s)
    n, iteration = len(s), 0
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
        trial = [sums(model, g, new[_part(g.windows.number)]) for g in groups]
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
        squares, counts = sum(p.squares for p in parts), sum(p.counts for p in parts)
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
            parts = [sums(model, g, s[_part(g.windows.number)]) for g in groups]
            cost = total(parts, s)
    return _with_covariance(groups, parts, s, prior_weight, free, cost, wander, iteration)


def _with_covariance(
    groups: list[Group], parts: list[Sums], s: Array, prior_weight: Array,
    free: NDArray[np.bool_], cost: float, unexplained: Array, iterations: int,
) -> Solution:  # fmt: skip
    n = len(s)
    A, B = np.diag(prior_weight), np.diag(prior_weight).astype(float)
    for g, p in zip(groups, parts, strict=True):
        where = _part(g.windows.number)
        gain = np.linalg.inv(p.Hzz) @ p.Hzs
        A[np.ix_(where, where)] += (p.Hss - p.Hzs.transpose(0, 2, 1) @ gain).sum(axis=0)
        score = p.gs - (gain.transpose(0, 2, 1) @ p.gz[:, :, None])[:, :, 0]
        for first in range(0, len(score), _CLUSTER):
            block = score[first : first + _CLUSTER].sum(axis=0)
            B[np.ix_(where, where)] += np.outer(block, block)
    inverse = np.zeros((n, n))
    inverse[np.ix_(free, free)] = np.linalg.inv(A[np.ix_(free, free)])
    robust = inverse @ B @ inverse
    scale = np.sqrt(np.maximum(1.0, np.diag(inverse) / np.maximum(np.diag(robust), 1e-300)))
    covariance = robust * scale[:, None] * scale[None, :]
    return Solution(s, covariance, A, groups, cost, unexplained, iterations)
