"""Samples as columns: the arrays that numpy would make of them, and parts of an array as tuples."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from signals._kernel import TupleReader, sample_columns
from signals.samples import BaroSample, GpsSample, ImuSample, TruthState


class Odd(NamedTuple):
    value: Any


TRUTHS = [
    TruthState(
        k,
        k * 4_000_000,
        (0.1 * k, -0.0, math.inf),
        (1.0, 0.0, math.nan, 5e-324),
        *[(float(k), 1e308, -1e-308)] * 4,
        (700.0, 701.5, 702.25, 703.125),
        k % 2 == 0,
    )
    for k in range(7)
]
SAMPLES: dict[str, list[Any]] = {
    "truth": TRUTHS,
    "imu": [ImuSample(k, k, k + 2, (0.5, k / 3, -9.8), (1e-3, 0.0, -0.0), 40.0) for k in range(3)],
    "baro": [BaroSample(k, k, k, 101325.0 - k, float(k), 15.0) for k in range(2)],
    "gps": [GpsSample(0, 2**62, -(2**63), 47.0, 8.0, 488.0, (1.0, 2.0, 3.0), 0.5, 0.8, 3, 12)],
}


@pytest.mark.parametrize("rows", SAMPLES.values(), ids=SAMPLES)
def test_columns_are_those_that_numpy_makes(rows: list[Any]) -> None:
    for column, values in zip(sample_columns(rows), zip(*rows, strict=True), strict=True):
        expected = np.array(values)
        assert (column.dtype, column.shape) == (expected.dtype, expected.shape)
        assert column.tobytes() == expected.tobytes()
        assert column.flags.c_contiguous


@pytest.mark.parametrize("values", [[1, 2.5], [0.0, 3], [True, True], [(), ()]])
def test_mixed_numbers_and_empty_tuples(values: list[Any]) -> None:
    (column,) = sample_columns([Odd(value) for value in values])
    expected = np.array(values)
    assert (column.dtype, column.shape) == (expected.dtype, expected.shape)
    assert column.tolist() == expected.tolist()


@pytest.mark.parametrize("values", [["a", "b"], [None, 1.0], [1.0, None], [(1, 2), (3, 4)], [((1.0,),), ((2.0,),)]])
def test_what_is_no_number_is_left_to_the_caller(values: list[Any]) -> None:
    assert sample_columns([Odd(value) for value in values]) == [None]


@pytest.mark.parametrize(
    ("rows", "error"),
    [
        ([], "no sample"),
        ([(1.0,), (1.0, 2.0)], "all of one length"),
        ([(1.0,), 2.0], "are tuples"),
        ([((1.0, 2.0),), ((1.0,),)], "not equally long"),
        ([((1.0, 2.0),), (3.0,)], "not equally long"),
    ],
)
def test_rows_that_do_not_fit_are_refused(rows: list[Any], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        sample_columns(rows)


def test_a_tuple_with_what_is_no_number_is_refused() -> None:
    with pytest.raises(TypeError):
        sample_columns([((1.0, 2.0),), ((1.0, "2"),)])


def test_a_reader_sees_the_array_as_it_is_now() -> None:
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    read = TupleReader(values, [(3, 5), (0, 2), (2, 2)]).read
    assert read() == ((4.0, 5.0), (1.0, 2.0), ())
    values *= 10.0
    assert read() == ((40.0, 50.0), (10.0, 20.0), ())
    assert type(read()[0][0]) is float


@pytest.mark.parametrize("part", [(0, 6), (4, 3)])
def test_a_part_outside_of_the_array_is_refused(part: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="not inside"):
        TupleReader(np.zeros(5), [part])
