"""Numbers of the tables: what Python's repr writes, digit by digit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sim._kernels import number_rows


def row_of(*values: float) -> str:
    of_array, of_tuple = (
        number_rows(np.zeros(1, np.int64), [column], -1) for column in (np.array([values], float), values)
    )
    assert of_array == of_tuple
    return of_array.removeprefix("0,").removesuffix("\n")


@given(st.lists(st.floats(), min_size=1, max_size=6))
@example([0.0, -0.0, 1e16, 9999999999999998.0, 1e-4, 9.999e-5, 1e22, 1e23, 5e-324, 1.7976931348623157e308])
@example([123456789012345680.0, 1234567890123456.8, 0.1, 1.0, 100.0, -2.5, 1e100, 1e-100, 2.0**53])
def test_as_repr(values: list[float]) -> None:
    assert row_of(*values) == ",".join(map(repr, values))


def test_every_decade() -> None:
    values = [sign * digits * 10.0**e for sign in (1, -1) for digits in (1.0, 1.25, math.pi) for e in range(-30, 30)]
    assert row_of(*values).split(",") == [repr(value) for value in values]


def test_tuples_are_of_numbers() -> None:
    assert number_rows(np.zeros(1, np.int64), [(1, 2.5, True)], -1) == "0,1.0,2.5,1.0\n"


@pytest.mark.parametrize("wrong", ["1", None, (2.0,), 10**400])
def test_only_numbers(wrong: object) -> None:
    with pytest.raises((TypeError, OverflowError)):
        number_rows(np.zeros(1, np.int64), [(wrong,)], -1)  # type: ignore[list-item]
