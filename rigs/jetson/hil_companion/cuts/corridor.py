"""A corridor of a radius round the straight legs, and the path of least snap that stays in it.

A circle is no linear constraint. At a sampled place of a leg the offset from it is held within a regular octagon in the
plane across the leg, and the overshoot along it within what the octagon leaves of the radius: what holds at a sample
lies within the radius of the leg. Between samples nothing is promised, so samples are added where the path still
leaves the corridor until it does not.

The only file that needs CasADi.
"""

from __future__ import annotations

import contextlib
import io
import math
from typing import Any, NamedTuple

import numpy as np

from hil_companion.cuts.snap_path import SAMPLES, SnapPath
from hil_companion.cuts.snap_program import SnapProgram

ACROSS = math.cos(math.pi / 8)  # of the radius: the octagon's inner circle
ALONG = math.sin(math.pi / 8)  # so that ACROSS^2 + ALONG^2 = 1
TOLERANCE = 1e-6  # of the radius
MAX_ROUNDS = 20
SOLVERS = ("qpoases", "osqp")  # the first is exact, but not in every build


class Solution(NamedTuple):
    """Of min 1/2 x'Hx + g'x with low <= A x <= high: all three axes one behind the other in x."""

    x: np.ndarray
    multipliers: np.ndarray
    H: np.ndarray
    g: np.ndarray
    A: np.ndarray
    low: np.ndarray
    high: np.ndarray


def distances_m(path: SnapPath, waypoints_W: np.ndarray, parts: int = 1) -> np.ndarray:
    """How far the path is from its leg, at the samples of each segment."""
    p_W = path.sampled(0)
    far = np.empty(p_W.shape[:2])
    for i in range(len(p_W)):
        a, b = waypoints_W[i // parts], waypoints_W[i // parts + 1]
        leg, offset = b - a, p_W[i] - a
        along = np.clip(offset @ leg / (leg @ leg), 0.0, 1.0)
        far[i] = np.linalg.norm(offset - along[:, None] * leg, axis=1)
    return far


def available() -> bool:
    """Whether CasADi is installed, with a solver of quadratic programs."""
    try:
        return _solver() is not None
    except ImportError:
        return False


def path_within(program: SnapProgram, radius_m: float) -> SnapPath | None:
    """The path of least snap in the corridor; None where none was found."""
    path = program.path(program.least())
    samples: list[tuple[int, int]] = []
    for _ in range(MAX_ROUNDS):
        left = _left(distances_m(path, program.waypoints_W, program.parts), radius_m)
        left = [sample for sample in left if sample not in samples]
        if not left:
            break
        samples += left
        solution = solve(program, samples, radius_m)
        if solution is None:
            return None
        path = program.path(solution.x.reshape(3, -1).T)
    far = distances_m(path, program.waypoints_W, program.parts)
    return path if far.max() <= radius_m * (1.0 + 10.0 * TOLERANCE) else None


def _left(far_m: np.ndarray, radius_m: float) -> list[tuple[int, int]]:
    """Samples (segment, number) outside: of each stretch outside the farthest, and some of the rest."""
    found = []
    for i, row in enumerate(far_m):
        outside = row > radius_m * (1.0 + TOLERANCE)
        for j in np.flatnonzero(outside):
            beside = row[max(j - 1, 0) : j + 2]
            if row[j] >= beside.max() or j % 8 == 4:
                found.append((i, int(j)))
    return found


def solve(program: SnapProgram, samples: list[tuple[int, int]], radius_m: float) -> Solution | None:
    """The program with the corridor at these samples. None where the solver finds no solution."""
    import casadi

    n = len(program.free)
    H = np.kron(np.eye(3), program.H)
    g = program.g.T.reshape(-1)
    rows, constants = program.split(program.snap_jumps())
    A = [np.kron(np.eye(3), rows)]
    low = [-constants.T.reshape(-1)]
    high = [-constants.T.reshape(-1)]
    for segment, number in samples:
        row, constant = program.split(program.row(segment, number / SAMPLES, 0)[None])
        leg = segment // program.parts
        a, b = program.waypoints_W[leg], program.waypoints_W[leg + 1]
        for axis, least, most in _sides(a, b, radius_m):
            A.append(np.kron(axis, row[0])[None])
            at = float(axis @ (constant[0] - a))
            low.append(np.array([least - at]))
            high.append(np.array([most - at]))
    stacked, lows, highs = np.concatenate(A), np.concatenate(low), np.concatenate(high)
    quadratic = casadi.DM(H)
    linear = casadi.DM(stacked) if len(stacked) else casadi.DM(0, 3 * n)
    found = _solver()
    if found is None:
        return None
    name, options = found
    # qpOASES says its name at every start, whatever it is told; CasADi writes through Python's own stdout.
    with contextlib.redirect_stdout(io.StringIO()):
        solver = casadi.conic("corridor", name, {"h": quadratic.sparsity(), "a": linear.sparsity()}, options)
        result = solver(h=quadratic, g=g, a=linear, lba=lows, uba=highs)
    if not solver.stats()["success"]:
        return None
    x, multipliers = (np.array(result[key]).reshape(-1) for key in ("x", "lam_a"))
    return Solution(x, multipliers, H, g, stacked, lows, highs)


def _sides(a: np.ndarray, b: np.ndarray, radius_m: float) -> list[tuple[np.ndarray, float, float]]:
    """Directions, and how far from `a` the path may be in each."""
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length
    other = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = np.cross(along, other)
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    half = math.sqrt(0.5)
    across = (first, second, half * (first + second), half * (first - second))
    sides = [(axis, -ACROSS * radius_m, ACROSS * radius_m) for axis in across]
    return [*sides, (along, -ALONG * radius_m, length + ALONG * radius_m)]


def _solver() -> tuple[str, dict[str, Any]] | None:
    import casadi

    options: dict[str, dict[str, Any]] = {
        "qpoases": {"printLevel": "none", "sparse": False},
        "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-7, "eps_rel": 1e-7, "max_iter": 50_000, "polish": True}},
    }
    for name in SOLVERS:
        if casadi.has_conic(name):
            return name, {"error_on_fail": False, **options[name]}
    return None
