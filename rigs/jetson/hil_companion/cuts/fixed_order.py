"""Products and solutions of small matrices with the same bits on every machine.

BLAS and LAPACK choose the order of their sums by processor and number of threads, and `pow` of the C library its code.
Here every sum and product has a fixed order, of operations element by element, each rounded once (IEEE 754).
"""

from __future__ import annotations

import numpy as np


def power(x: float, n: int) -> float:
    """Return x^n for n >= 0."""
    value = 1.0
    for _ in range(n):
        value *= float(x)
    return value


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the matrix product of a (m, n) and b (n, k)."""
    total = a[:, :1] * b[:1]
    for i in range(1, a.shape[1]):
        total = total + a[:, i : i + 1] * b[i : i + 1]
    return np.asarray(total)


def solved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x (n, k) with a x = b: Gaussian elimination with partial pivoting. `a` (n, n) must not be singular."""
    n = len(a)
    rows = np.concatenate([a, b], axis=1)
    for i in range(n):
        pivot = i + int(np.argmax(np.abs(rows[i:, i])))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i + 1 :, i:] -= rows[i + 1 :, i : i + 1] / rows[i, i] * rows[i, i:]
    x = np.zeros_like(rows[:, n:])
    for i in range(n - 1, -1, -1):
        x[i] = rows[i, n:] / rows[i, i]
        rows[:i, n:] -= rows[:i, i : i + 1] * x[i]
    return x
