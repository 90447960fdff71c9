"""One step of the integration for many windows at once, with its Jacobians, and the state anywhere within it.

Classical Runge-Kutta method with the stages k_1 .. k_4; within the step the polynomial of third order through them
(Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, section II.6):
    z(t + x h) = z + h sum b_i(x) k_i,
    b_1 = x - 3/2 x^2 + 2/3 x^3,  b_2 = b_3 = x^2 - 2/3 x^3,  b_4 = -1/2 x^2 + 2/3 x^3
Its error, of order h^4, is that of the step. A reading is compared with it at its own time, and so sees the bend of the
motion and the command of its own step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit.flight_model import Differentiated, FlightModel

Array = NDArray[np.float64]


class Within(NamedTuple):
    """State [states, W] within a step, its slope in time [W, rows], and Jacobians of `rows` of it to z and s."""

    z: Array
    slope: Array
    F: Array  # [W, rows, states]
    B: Array  # [W, rows, unknowns]


def rates(f: Differentiated, *args: Array) -> tuple[Array, Array, Array]:
    """Return value [W, n], Jacobian to z [W, n, nz] and to s [W, n, ns] for columns of arguments [rows, W].

    An argument may be [rows, 1]: the same for all.
    """
    (n, nz, ns), W = f.shape, args[0].shape[1]
    value, A, B = np.zeros((W, n)), np.zeros((W, n * nz)), np.zeros((W, n * ns))
    f.program.evaluate([np.ascontiguousarray(x, np.float64) for x in args], [value, A, B])
    return value, A.reshape(W, n, nz), B.reshape(W, n, ns)


def between(u: Array, x: Array, rotors: int, step_s: float) -> Array:
    """Return the inputs [inputs, W] with the motors at the shares x [W] of the step in place of those at its start.

    Signal and slope are those of the parabola through start, middle and end.
    """
    start, middle, end = (u[i * 3 * rotors : (i * 3 + 1) * rotors] for i in range(3))
    out = u.copy()
    out[:rotors] = (1.0 - x) * (1.0 - 2.0 * x) * start + 4.0 * x * (1.0 - x) * middle + x * (2.0 * x - 1.0) * end
    out[rotors : 2 * rotors] = ((4.0 * x - 3.0) * start + (4.0 - 8.0 * x) * middle + (4.0 * x - 1.0) * end) / step_s
    return out


class Step:
    """The step of `W` windows; keeps its arrays from step to step."""

    def __init__(self, model: FlightModel, W: int) -> None:
        n, nz, ns = model.rates[0].shape
        self._model = model
        self._flat = [(np.zeros((W, n)), np.zeros((W, n * nz)), np.zeros((W, n * ns))) for _ in range(4)]
        self._stages = [(k, A.reshape(W, n, nz), B.reshape(W, n, ns)) for k, A, B in self._flat]
        self._z = np.zeros((nz, W))
        self._slopes: list[tuple[Array, Array, Array]] = []  # of the stages: k, and its Jacobians to the step's start

    def start(self, z: Array, s: Array, u: Array) -> None:
        """Evaluate the stages of the step from z [nz, W], with the unknowns s [ns, 1] and inputs u [inputs, W]."""
        h, (first, middle, end) = self._model.step_s, self._model.rates
        self._z = z
        first.program.evaluate([z, s, u], list(self._flat[0]))
        k, A, B = self._stages[0]
        self._slopes = [(k, A, B)]
        for stage, (f, part) in enumerate(((middle, 0.5 * h), (middle, 0.5 * h), (end, h)), 1):
            f.program.evaluate([z + part * np.ascontiguousarray(k.T), s, u], list(self._flat[stage]))
            k, a, b = self._stages[stage]
            A, B = a + part * (a @ A), b + part * (a @ B)
            self._slopes.append((k, A, B))

    def end(self) -> tuple[Array, Array, Array]:
        """Return the state [nz, W] at the end of the step and its Jacobians to its start and to s [W, nz, ...]."""
        (k1, A1, B1), (k2, A2, B2), (k3, A3, B3), (k4, A4, B4) = self._slopes
        part = self._model.step_s / 6.0
        F = part * (A1 + 2.0 * (A2 + A3) + A4)
        F[:, np.arange(len(self._z)), np.arange(len(self._z))] += 1.0
        z = self._z + part * (k1 + 2.0 * (k2 + k3) + k4).T
        return np.ascontiguousarray(z), F, part * (B1 + 2.0 * (B2 + B3) + B4)

    def within(self, x: Array, rows: slice) -> Within:
        """Return the state at the shares x [W] of the step; slope and Jacobians of `rows` alone."""
        h, x2, x3 = self._model.step_s, x * x, x * x * x
        middle = x2 - 2.0 / 3.0 * x3
        weights = h * np.array([x - 1.5 * x2 + 2.0 / 3.0 * x3, middle, middle, 2.0 / 3.0 * x3 - 0.5 * x2])
        bend = 2.0 * x - 2.0 * x2
        speeds = np.array([1.0 - 3.0 * x + 2.0 * x2, bend, bend, 2.0 * x2 - x])
        z = self._z.copy()
        slope = np.zeros((len(x), len(range(*rows.indices(len(z))))))
        F, B = np.zeros_like(self._slopes[0][1][:, rows]), np.zeros_like(self._slopes[0][2][:, rows])
        for weight, speed, (k, A, Bk) in zip(weights, speeds, self._slopes, strict=True):
            z += weight * k.T
            slope += speed[:, None] * k[:, rows]
            F += weight[:, None, None] * A[:, rows]
            B += weight[:, None, None] * Bk[:, rows]
        first = rows.indices(len(z))[0]
        F[:, np.arange(F.shape[1]), first + np.arange(F.shape[1])] += 1.0
        return Within(z, slope, F, B)
