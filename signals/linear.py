"""Small systems of linear equations with a fixed order of operations: the same bits on every machine."""

from __future__ import annotations

from collections.abc import Sequence


def inverse(matrix: Sequence[Sequence[float]], least_pivot: float) -> list[list[float]] | None:
    """Return the inverse by Gauss-Jordan elimination with pivots; None if a pivot is not above `least_pivot`."""
    n = len(matrix)
    rows = [[*row, *(1.0 if i == j else 0.0 for j in range(n))] for i, row in enumerate(matrix)]
    for column in range(n):
        pivot = max(range(column, n), key=lambda row: abs(rows[row][column]))
        if not abs(rows[pivot][column]) > least_pivot:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        scale = rows[column][column]
        rows[column] = [value / scale for value in rows[column]]
        for row in range(n):
            factor = rows[row][column]
            if row != column and factor != 0.0:
                rows[row] = [value - factor * top for value, top in zip(rows[row], rows[column], strict=True)]
    return [row[n:] for row in rows]
