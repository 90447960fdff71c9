"""Least snap through waypoints, as a quadratic program in what the path is at its nodes.

Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, minimise the integral
of the squared 4th derivative of piecewise polynomials under equalities at the waypoints and a corridor between them.
The polynomials are written here by position, velocity, acceleration and jerk at both ends of each segment, which fixes
7th order, makes derivatives up to the 3rd continuous of itself, and keeps the numbers of one size (Richter, Bry and
Roy, "Polynomial trajectory planning for aggressive quadrotor flight", ISRR 2013). Time is counted in mean durations.

    minimise 1/2 x' H x + g' x     x: what is free at the nodes, one column an axis
    with     snap before a node = snap behind it
"""

from __future__ import annotations

from typing import Collection

import numpy as np

from hil_companion.cuts.snap_path import SnapPath, derivative_row, snap_weights

AT_NODE = 4  # position, velocity, acceleration, jerk


class SnapProgram:
    """Legs between `waypoints_W`, each of `parts` segments. At `stops` (waypoint numbers) and both ends it rests."""

    def __init__(
        self, waypoints_W: np.ndarray, leg_times_s: np.ndarray, *, parts: int = 1, stops: Collection[int] = ()
    ) -> None:
        self.waypoints_W = np.asarray(waypoints_W, float)
        self.parts = parts
        legs = len(self.waypoints_W) - 1
        self._unit_s = float(np.mean(leg_times_s)) / parts
        self.times = np.repeat(np.asarray(leg_times_s, float), parts) / parts / self._unit_s
        nodes = legs * parts + 1
        self.size = AT_NODE * nodes
        self._stops = {0, legs, *stops}
        self.known = np.full((self.size, 3), np.nan)
        for i, p_W in enumerate(self.waypoints_W):
            first = AT_NODE * i * parts
            self.known[first] = p_W
            if i in self._stops:
                self.known[first + 1 : first + AT_NODE] = 0.0
        self.free = np.flatnonzero(np.isnan(self.known[:, 0]))
        fixed = np.flatnonzero(~np.isnan(self.known[:, 0]))
        self._to_coefficients = [self._end_values_to_coefficients(t) for t in self.times]
        whole = self._cost()
        self.H = whole[np.ix_(self.free, self.free)]
        self.g = whole[np.ix_(self.free, fixed)] @ self.known[fixed]
        self._fixed = fixed

    @staticmethod
    def _end_values_to_coefficients(time: float) -> np.ndarray:
        at_ends = np.array([derivative_row(s, k) / time**k for s in (0.0, 1.0) for k in range(AT_NODE)])
        inverse: np.ndarray = np.linalg.inv(at_ends)
        return inverse

    def _cost(self) -> np.ndarray:
        whole, weights = np.zeros((self.size, self.size)), snap_weights()
        for i, (time, to_c) in enumerate(zip(self.times, self._to_coefficients)):
            span = self._span(i)
            whole[span, span] += 2.0 * to_c.T @ weights @ to_c / time**7
        return whole

    def _span(self, segment: int) -> slice:
        return slice(AT_NODE * segment, AT_NODE * (segment + 2))

    def row(self, segment: int, s: float, k: int) -> np.ndarray:
        """The k-th derivative there, as a row to be multiplied by all that is at the nodes."""
        row = np.zeros(self.size)
        row[self._span(segment)] = derivative_row(s, k) @ self._to_coefficients[segment] / self.times[segment] ** k
        return row

    def split(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """rows @ nodes as (rows for what is free, constant of what is fixed, a column an axis)."""
        return rows[:, self.free], rows[:, self._fixed] @ self.known[self._fixed]

    def snap_jumps(self) -> np.ndarray:
        """Rows that are zero where the snap is continuous: at the inner nodes at which the path does not stop."""
        inner = [n for n in range(1, len(self.times)) if n % self.parts or n // self.parts not in self._stops]
        rows = [self.row(n - 1, 1.0, 4) - self.row(n, 0.0, 4) for n in inner]
        return np.array(rows).reshape(len(rows), self.size)

    def least(self) -> np.ndarray:
        """Without a corridor, in closed form: the snap, and two derivatives more, are continuous of themselves."""
        if not len(self.free):
            return np.zeros((0, 3))
        x: np.ndarray = np.linalg.solve(self.H, -self.g)
        return x

    def path(self, x: np.ndarray) -> SnapPath:
        nodes = self.known.copy()
        nodes[self.free] = x
        coefficients = [to_c @ nodes[self._span(i)] for i, to_c in enumerate(self._to_coefficients)]
        return SnapPath(self.times * self._unit_s, np.array(coefficients))
