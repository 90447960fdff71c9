"""ddmin and the bisection of numbers against oracles whose smallest failing sets are known."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.apps.campaign.find.ddmin import ddmin
from hil.apps.campaign.find.magnitudes import least_share


class Oracle:
    """Fails with every superset of one of `causes`."""

    def __init__(self, *causes: set[int]) -> None:
        self.causes, self.tested = causes, 0

    def fails(self, items: Sequence[int]) -> bool:
        return any(cause <= set(items) for cause in self.causes)

    def first_failing(self, subsets: Sequence[list[int]]) -> int | None:
        self.tested += len(subsets)
        return next((i for i, subset in enumerate(subsets) if self.fails(subset)), None)


@pytest.mark.parametrize(
    ("causes", "count", "smallest"),
    [
        ([{3}], 8, [3]),
        ([{0, 7}], 8, [0, 7]),
        ([set()], 5, []),  # the base fails
        ([{2, 3, 4, 5}], 20, [2, 3, 4, 5]),
        ([set(range(9))], 9, list(range(9))),  # all are needed
        ([{0}], 1, [0]),
    ],
)
def test_the_smallest_set_is_found(causes: list[set[int]], count: int, smallest: list[int]) -> None:
    oracle = Oracle(*causes)
    assert ddmin(range(count), oracle.first_failing) == smallest


@given(
    st.integers(1, 24).flatmap(
        lambda n: st.tuples(st.just(n), st.lists(st.sets(st.integers(0, n - 1), max_size=5), min_size=1, max_size=3))
    )
)
def test_no_single_item_can_be_taken_out_of_the_result(case: tuple[int, list[set[int]]]) -> None:
    count, causes = case
    oracle = Oracle(*causes)
    found = ddmin(range(count), oracle.first_failing)
    assert oracle.fails(found)
    assert found == sorted(found)
    assert not any(oracle.fails([x for x in found if x != item]) for item in found)


def test_one_cause_of_many_needs_few_tests() -> None:
    """Zeller and Hildebrandt, proposition 12: at most 2 log2(n) tests for one cause, if subsets are tested in turn."""
    oracle = Oracle({77})
    assert ddmin(range(128), oracle.first_failing) == [77]
    assert oracle.tested <= 2 * 7 + 1  # and the empty set


@pytest.mark.parametrize("threshold", [0.0, 1e-9, 0.2, 0.5, 0.61, 0.999, 1.0])
@pytest.mark.parametrize("tolerance", [0.25, 1 / 16, 1e-3])
def test_the_least_share_is_bracketed(threshold: float, tolerance: float) -> None:
    def first_failing(shares: Sequence[float]) -> int | None:
        assert list(shares) == sorted(shares)
        return next((i for i, share in enumerate(shares) if share >= threshold), None)

    share = least_share(first_failing, tolerance)
    assert threshold <= share <= threshold + tolerance
