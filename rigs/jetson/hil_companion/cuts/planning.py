"""Minimum-snap path through waypoints, within a corridor about the straight legs, as fast as the limits allow.

Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, minimise the integral
of the squared 4th derivative of piecewise polynomials through waypoints. Here each polynomial is defined by position,
velocity, acceleration and jerk at both ends of its segment. It is therefore of 7th order, derivatives up to the 3rd are
continuous, and the optimum has a closed form (Richter, Bry and Roy, "Polynomial trajectory planning for aggressive
quadrotor flight", ISRR 2013). As in that paper, a segment that leaves the corridor gets one more waypoint in its
middle, until no segment leaves it.

    minimise 1/2 x' H x + g' x     x: free values at the nodes, a column per axis; time in mean durations
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil_companion.cuts.fixed_order import power, product, solved
from hil_companion.cuts.snap_path import SnapPath, derivative_row, snap_weights

SAME_PLACE_M = 0.05
MAX_LEGS = 12  # planned together; the equations are dense, and their solution takes cubic time
MAX_ROUNDS = 10  # rounds of added waypoints; after 10 halvings a segment is a thousandth of its leg
MARGIN = 1.001  # because peaks may lie between the samples
NODE_VALUES = 4  # position, velocity, acceleration, jerk
MIN_BEND = 1e-6  # lower bound of 1 / cos(turn / 2) - 1


@dataclass(frozen=True)
class Limits:
    """Limits of a path. `corridor_m`: largest distance from the straight legs."""

    speed_mps: float
    accel_mps2: float
    corridor_m: float


def without_repeats(waypoints_W: np.ndarray) -> np.ndarray:
    """Return the waypoints (n, 3) without those at the same place as the one before."""
    kept: list[np.ndarray] = []
    for p_W in np.asarray(waypoints_W, float).reshape(-1, 3):
        if not kept or float(np.linalg.norm(p_W - kept[-1])) > SAME_PLACE_M:
            kept.append(p_W)
    return np.array(kept).reshape(-1, 3)


def plan(waypoints_W: np.ndarray, limits: Limits) -> SnapPath:
    """Plan a path from rest at the first to rest at the last waypoint. Raises ValueError for fewer than two."""
    points = without_repeats(waypoints_W)
    if len(points) < 2:
        raise ValueError("a path needs at least two waypoints that are not at the same place")
    whole: SnapPath | None = None
    for first in range(0, len(points) - 1, MAX_LEGS):
        path = _within_corridor(points[first : first + MAX_LEGS + 1], limits)
        whole = path if whole is None else whole.followed_by(path)
    assert whole is not None
    return whole


def _within_corridor(points_W: np.ndarray, limits: Limits) -> SnapPath:
    nodes_W = points_W
    for _ in range(MAX_ROUNDS):
        path = least_snap(nodes_W, leg_times_s(nodes_W, limits))
        outside = np.flatnonzero(distances_m(path, nodes_W).max(axis=1) > limits.corridor_m)
        if not len(outside):
            return _timed(path, limits)
        nodes_W = np.insert(nodes_W, outside + 1, 0.5 * (nodes_W[outside] + nodes_W[outside + 1]), axis=0)
    # The corridor is too narrow for curves: fly the straight legs one by one, each from rest to rest.
    legs = [least_snap(points_W[i : i + 2], np.ones(1)) for i in range(len(points_W) - 1)]
    whole = _timed(legs[0], limits)
    for leg in legs[1:]:
        whole = whole.followed_by(_timed(leg, limits))
    return whole


def least_snap(nodes_W: np.ndarray, times_s: np.ndarray) -> SnapPath:
    """Return the minimum-snap path through all nodes from rest to rest, with one segment between two nodes."""
    unit_s = float(np.mean(times_s))
    times = times_s / unit_s
    known = np.full((NODE_VALUES * len(nodes_W), 3), np.nan)
    known[::NODE_VALUES] = nodes_W
    known[1:NODE_VALUES] = known[1 - NODE_VALUES :] = 0.0
    spans = [slice(NODE_VALUES * i, NODE_VALUES * (i + 2)) for i in range(len(times))]
    to_coefficients = [_to_coefficients(time) for time in times]
    cost, weights = np.zeros((len(known), len(known))), snap_weights()
    for span, time, to_c in zip(spans, times, to_coefficients):
        cost[span, span] += 2.0 * product(product(to_c.T, weights), to_c) / power(time, 7)
    is_free = np.isnan(known[:, 0])
    free, fixed = np.flatnonzero(is_free), np.flatnonzero(~is_free)
    if len(free):
        known[free] = solved(cost[np.ix_(free, free)], product(-cost[np.ix_(free, fixed)], known[fixed]))
    return SnapPath(times_s, np.array([product(to_c, known[span]) for span, to_c in zip(spans, to_coefficients)]))


def _to_coefficients(time: float) -> np.ndarray:
    """Return the matrix from the values at both ends of a segment to its coefficients."""
    at_ends = np.array([derivative_row(s, k) / power(time, k) for s in (0.0, 1.0) for k in range(NODE_VALUES)])
    return solved(at_ends, np.eye(len(at_ends)))


def distances_m(path: SnapPath, nodes_W: np.ndarray) -> np.ndarray:
    """Return the distance of the path from the straight leg at each sample, (segments, samples)."""
    p_W = path.sampled(0)
    a, leg = nodes_W[:-1, None], np.diff(nodes_W, axis=0)[:, None]
    offset = p_W - a
    along = np.clip((offset * leg).sum(axis=2) / (leg * leg).sum(axis=2), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - along[:, :, None] * leg, axis=2))


def leg_times_s(nodes_W: np.ndarray, limits: Limits) -> np.ndarray:
    """Estimate the duration of each leg: corners at the speed that an arc allows, half of the acceleration between.

    v = sqrt(a R)     R (1 / cos(turn / 2) - 1) = the corridor's radius
    """
    legs = np.diff(nodes_W, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    cosines = (legs[:-1] * legs[1:]).sum(axis=1) / (lengths[:-1] * lengths[1:])
    half_cosines = np.sqrt(np.clip(0.5 * (1.0 + cosines), 1e-12, 1.0))  # of half the turn
    radius_m = limits.corridor_m / np.maximum(1.0 / half_cosines - 1.0, MIN_BEND)
    v = np.minimum(limits.speed_mps, np.sqrt(limits.accel_mps2 * radius_m))
    v, a = np.array([0.0, *v, 0.0]), 0.5 * limits.accel_mps2
    for here, there, i in [(i, i + 1, i) for i in range(len(legs))] + [(i + 1, i, i) for i in range(len(legs))][::-1]:
        v[there] = min(v[there], math.sqrt(v[here] ** 2 + 2.0 * a * lengths[i]))
    first, last = v[:-1], v[1:]
    top = np.minimum(limits.speed_mps, np.sqrt(a * lengths + 0.5 * (first**2 + last**2)))
    cruise_m = lengths - (2.0 * top**2 - first**2 - last**2) / (2.0 * a)
    return np.asarray((2.0 * top - first - last) / a + cruise_m / top)


def _timed(path: SnapPath, limits: Limits) -> SnapPath:
    """Scale the time of a path so that it reaches its speed or acceleration limit."""
    speed = float(np.linalg.norm(path.sampled(1), axis=2).max())
    accel = float(np.linalg.norm(path.sampled(2), axis=2).max())
    return path.stretched(MARGIN * max(speed / limits.speed_mps, (accel / limits.accel_mps2) ** 0.5))
