"""Allocation of torques and collective thrust to the rotors of a multirotor.

    T = M (tau_x, tau_y, tau_z, F),   M = B^T (B B^T)^-1

T_i = k O_i^2 is the thrust of rotor i alone, B the rows roll, pitch, yaw torque and thrust along z of
`Vehicle.effectiveness`. Where a rotor would leave its range, with r_i the part of roll and pitch and y_i that of yaw:

    1. r is scaled down only if it does not fit into the range by itself, or not at the collective thrust F or
       `raised_n`, whichever is more
    2. y is scaled down until r + y fits
    3. the collective thrust moves, up to that bound or down, until r + y + thrust fits

So roll and pitch go before yaw, and yaw before thrust, but torques do not lift a vehicle whose bound is below its
weight. + - * / in fixed order only: the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from sim.physics.vehicle import Vehicle

ROLL, PITCH, YAW, THRUST = range(4)
_SINGULAR = 1e-9  # of the largest entry


class Allocation:
    """Inverse of one vehicle's rotor geometry. Raises ValueError if it cannot produce all torques and thrust."""

    def __init__(self, vehicle: Vehicle, *, least_n: float) -> None:
        k, top = vehicle.rotor_constants.thrust_coefficient_n_per_radps2, vehicle.rotor_constants.max_speed_radps
        effect = vehicle.effectiveness
        self.rows = [[float(value) for value in effect[row]] for row in (3, 4, 5, 2)]  # per newton of T, by axis
        self.columns = list(zip(*self.rows, strict=True))  # by rotor
        self.least_n, self.most_n = least_n, k * top * top
        self.raised_n = inf  # collective thrust up to which torques may raise it
        self.lift = _dot(self.rows[THRUST], (1.0,) * len(self.columns))  # thrust along z per newton of T of all rotors
        gram = [[_dot(a, b) for b in self.rows] for a in self.rows]
        inverse = _inverse(gram)
        if inverse is None:
            raise ValueError(
                f"the vehicle {vehicle.name!r} cannot be controlled: its rotors do not produce roll, pitch and yaw "
                "torque and thrust independently of each other; check positions, spins and moment_ratio_m"
            )
        self._mix = [tuple(_dot(column, row) for row in inverse) for column in self.columns]

    def yaw_torque_nm(self, change_n: float) -> float:
        """Return the yaw torque of a change of thrust by at most `change_n` of every rotor."""
        return change_n / max(abs(mix[YAW]) for mix in self._mix)

    def thrusts(self, torque_x_nm: float, torque_y_nm: float, torque_z_nm: float, thrust_n: float) -> list[float]:
        """Return the thrust of every rotor [N]."""
        wanted = [
            mx * torque_x_nm + my * torque_y_nm + mz * torque_z_nm + mt * thrust_n for mx, my, mz, mt in self._mix
        ]
        if min(wanted) >= self.least_n and max(wanted) <= self.most_n:
            return wanted
        return self._saturated(torque_x_nm, torque_y_nm, torque_z_nm, thrust_n)

    def _saturated(self, torque_x_nm: float, torque_y_nm: float, torque_z_nm: float, thrust_n: float) -> list[float]:
        least, most = self.least_n, self.most_n
        tilt = [mx * torque_x_nm + my * torque_y_nm for mx, my, _, _ in self._mix]
        yaw = [mix[YAW] * torque_z_nm for mix in self._mix]
        shares = [mix[THRUST] for mix in self._mix]
        bound_n = max(thrust_n, self.raised_n)
        fit = 1.0
        for t, s in zip(tilt, shares, strict=True):
            if s > 0.0 and t < 0.0 and fit * t + s * bound_n < least:
                fit = max(0.0, (least - s * bound_n) / t)
        tilt = [fit * t for t in tilt]
        spread = max(tilt) - min(tilt)
        if spread > most - least:
            scale = (most - least) / spread
            tilt, yaw = [scale * t for t in tilt], [0.0] * len(yaw)
        else:
            share = 1.0  # of the yaw torque; every pair of rotors bounds it
            for ta, ya in zip(tilt, yaw, strict=True):
                for tb, yb in zip(tilt, yaw, strict=True):
                    if ya - yb > 0.0 and (ta - tb) + share * (ya - yb) > most - least:
                        share = ((most - least) - (ta - tb)) / (ya - yb)
            yaw = [share * y for y in yaw]
        turn = [t + y for t, y in zip(tilt, yaw, strict=True)]
        level = thrust_n
        for t, s in zip(turn, shares, strict=True):
            if s > 0.0 and t + s * level < least:
                level = (least - t) / s
        for t, s in zip(turn, shares, strict=True):
            if s > 0.0 and t + s * level > most:
                level = (most - t) / s
        return [min(max(t + s * level, least), most) for t, s in zip(turn, shares, strict=True)]


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def _inverse(matrix: list[list[float]]) -> list[list[float]] | None:
    """Return the inverse, by Gauss-Jordan elimination with pivoting; None if the matrix is singular."""
    n = len(matrix)
    largest = max(abs(value) for row in matrix for value in row)
    rows = [[*row, *(1.0 if i == j else 0.0 for j in range(n))] for i, row in enumerate(matrix)]
    for column in range(n):
        pivot = max(range(column, n), key=lambda row: abs(rows[row][column]))
        if not abs(rows[pivot][column]) > _SINGULAR * largest:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        scale = rows[column][column]
        rows[column] = [value / scale for value in rows[column]]
        for row in range(n):
            factor = rows[row][column]
            if row != column and factor != 0.0:
                rows[row] = [value - factor * top for value, top in zip(rows[row], rows[column], strict=True)]
    return [row[n:] for row in rows]
