"""A motion of closed form, and the flight log that an x500 would have of it; also in NED and FRD, turned by matrices.

Position and attitude are smooth functions of time, so that velocity, rate and specific force follow by derivatives:

    p = (3 sin 0.5 t, 2 cos 0.4 t, 5 + sin 0.7 t)    R_WB = Rz(0.3 t) Ry(0.3 sin 0.9 t) Rx(0.4 sin 1.1 t)
    [w_B]x = R' dR/dt    f_B = R' (dv/dt + g e_z)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

G = 9.80665
NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])


class Motion(NamedTuple):
    t_s: Array
    p_WB: Array
    R_WB: Array  # [n, 3, 3]
    v_WB_W: Array
    w_WB_B: Array
    accel_B: Array
    motors: Array  # [n, 4] 0..1

    @property
    def q_WB(self) -> Array:
        return Rotation.from_matrix(self.R_WB).as_quat(scalar_first=True)

    @property
    def q_NF(self) -> Array:
        return Rotation.from_matrix(NED_FROM_ENU @ self.R_WB @ FRD_FROM_FLU.T).as_quat(scalar_first=True)

    def ned(self, rows: Array) -> Array:
        return rows @ NED_FROM_ENU.T

    def frd(self, rows: Array) -> Array:
        return rows @ FRD_FROM_FLU.T


def attitude(t: Array) -> Array:
    angles = np.stack([0.3 * t, 0.3 * np.sin(0.9 * t), 0.4 * np.sin(1.1 * t)], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix()


def motion(t_s: Array) -> Motion:
    t, h = t_s, 1e-5
    p = np.stack([3.0 * np.sin(0.5 * t), 2.0 * np.cos(0.4 * t), 5.0 + np.sin(0.7 * t)], axis=1)
    v = np.stack([1.5 * np.cos(0.5 * t), -0.8 * np.sin(0.4 * t), 0.7 * np.cos(0.7 * t)], axis=1)
    a = np.stack([-0.75 * np.sin(0.5 * t), -0.32 * np.cos(0.4 * t), -0.49 * np.sin(0.7 * t)], axis=1)
    R = attitude(t)
    w_x = np.swapaxes(R, 1, 2) @ ((attitude(t + h) - attitude(t - h)) / (2.0 * h))
    w = np.stack([w_x[:, 2, 1], w_x[:, 0, 2], w_x[:, 1, 0]], axis=1)
    f = np.einsum("nji,nj->ni", R, a + np.array([0.0, 0.0, G]))
    motors = 0.76 + 0.05 * np.stack([np.sin((1.0 + 0.2 * i) * t) for i in range(4)], axis=1)
    return Motion(t, p, R, v, w, f, motors)
