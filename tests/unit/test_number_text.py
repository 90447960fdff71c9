"""Numbers of the tables: what Python's repr writes, digit by digit."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sim._kernels import number_row


@given(st.lists(st.floats(), max_size=6))
@example([0.0, -0.0, 1e16, 9999999999999998.0, 1e-4, 9.999e-5, 1e22, 1e23, 5e-324, 1.7976931348623157e308])
@example([123456789012345680.0, 1234567890123456.8, 0.1, 1.0, 100.0, -2.5, 1e100, 1e-100, 2.0**53])
def test_as_repr(values: list[float]) -> None:
    assert number_row(tuple(values)) == ",".join(map(repr, values))


def test_every_decade() -> None:
    values = [sign * digits * 10.0**e for sign in (1, -1) for digits in (1.0, 1.25, math.pi) for e in range(-30, 30)]
    assert number_row(*values).split(",") == [repr(value) for value in values]


def test_tuples_and_numbers_stand_in_a_row() -> None:
    assert number_row(1, (2.5, True), (), 0.25) == "1.0,2.5,1.0,0.25"
    assert number_row() == ""


@pytest.mark.parametrize("wrong", ["1", None, ("x",), 10**400])
def test_only_numbers(wrong: object) -> None:
    with pytest.raises((TypeError, OverflowError)):
        number_row(wrong)  # type: ignore[arg-type]
