"""Allocation of torques and collective thrust to the rotors of a multirotor.

    T = M (tau_x, tau_y, tau_z, F),   M = B^T (B B^T)^-1

T_i = k O_i^2 is the thrust of rotor i alone, B the rows roll, pitch, yaw torque and thrust along z of
`multirotor.effectiveness`. Where a rotor would leave its range, with r_i the part of roll and pitch and y_i that of
yaw:

    1. r is scaled down only if it does not fit into the range by itself, or not at the collective thrust F or
       `raised_n`, whichever is more
    2. y is scaled down until r + y fits
    3. the collective thrust moves, up to that bound or down, until r + y + thrust fits

So roll and pitch go before yaw, and yaw before thrust, but torques do not lift a vehicle whose bound is below its
weight. The steps are native code (sim/native/ideal_controller.cpp): the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from signals.linear import inverse
from sim._kernels import allocate
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle

ROLL, PITCH, YAW, THRUST = range(4)
_SINGULAR = 1e-9  # of the largest entry


class Allocation:
    """Inverse of one vehicle's rotor geometry.

    Raises ValueError if its rotors cannot produce all torques and thrust, or are of several sets.
    """

    def __init__(self, vehicle: Vehicle, *, least_n: float, density_ratio: float = 1.0) -> None:
        if (found := multirotor.uneven(vehicle)) is not None:
            raise ValueError(f"the vehicle {vehicle.name!r} cannot be controlled: {found[0]} {found[1]}")
        k = density_ratio * vehicle.rotor_constants.thrust_coefficient_n_per_radps2
        top = vehicle.rotor_constants.max_speed_radps
        effect = multirotor.effectiveness(vehicle)
        self.rows = [[float(value) for value in effect[row]] for row in (3, 4, 5, 2)]  # per newton of T, by axis
        self.columns = list(zip(*self.rows, strict=True))  # by rotor
        self.least_n, self.most_n = least_n, k * top * top
        self.raised_n = inf  # collective thrust up to which torques may raise it
        self.lift = _dot(self.rows[THRUST], (1.0,) * len(self.columns))  # thrust along z per newton of T of all rotors
        gram = [[_dot(a, b) for b in self.rows] for a in self.rows]
        inverted = inverse(gram, _SINGULAR * max(abs(value) for row in gram for value in row))
        if inverted is None:
            raise ValueError(
                f"the vehicle {vehicle.name!r} cannot be controlled: its rotors do not produce roll, pitch and yaw "
                "torque and thrust independently of each other; check positions, spins and moment_ratio_m"
            )
        # (rotors, 4): thrust of a rotor per roll, pitch, yaw torque and collective thrust
        self.mix = np.array([[_dot(column, row) for row in inverted] for column in self.columns])

    def yaw_torque_nm(self, change_n: float) -> float:
        """Return the yaw torque of a change of thrust by at most `change_n` of every rotor."""
        return change_n / max(abs(value) for value in self.mix[:, YAW].tolist())

    def thrusts(self, torque_x_nm: float, torque_y_nm: float, torque_z_nm: float, thrust_n: float) -> list[float]:
        """Return the thrust of every rotor [N]."""
        limits_n = (self.least_n, self.most_n, self.raised_n)
        return list(allocate(self.mix, limits_n, (torque_x_nm, torque_y_nm, torque_z_nm, thrust_n)))


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total
