"""Latency histogram: quantiles within a bin of the exact ones."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from signals.latency import LatencyHistogram


@given(
    st.lists(st.integers(0, 10**12), min_size=1, max_size=300),
    st.sampled_from([0.0, 0.25, 0.5, 0.9, 0.99, 1.0]),
)
def test_quantiles_are_within_a_bin(durations: list[int], q: float) -> None:
    histogram = LatencyHistogram()
    for d in durations:
        histogram.add(d)
    exact = sorted(durations)[int(q * (len(durations) - 1))]
    # rank rounds down to an element: compare with that element, to half a bin (1/64) and the integer step.
    assert abs(histogram.quantile_ns(q) - exact) <= exact / 32 + 1
    assert histogram.count == len(durations)
    assert histogram.max_ns == max(durations)
    assert sum(n for _, n in histogram.bins()) == len(durations)


@given(st.lists(st.one_of(st.integers(-5, 200), st.integers(-(10**9), 2**62)), max_size=300))
def test_many_at_once_are_counted_as_one_by_one(durations: list[int]) -> None:
    together, single = LatencyHistogram(), LatencyHistogram()
    together.add_all(durations)
    for d in durations:
        single.add(d)
    assert together.bins() == single.bins()
    assert (together.count, together.total_ns, together.max_ns) == (single.count, single.total_ns, single.max_ns)


@given(st.integers(6, 62), st.integers(-3, 3))
def test_the_bin_near_a_power_of_two_is_that_of_one_by_one(power: int, beside: int) -> None:
    together, single = LatencyHistogram(), LatencyHistogram()
    together.add_all([2**power + beside])
    single.add(2**power + beside)
    assert together.bins() == single.bins()


def test_empty_and_clock_going_backwards() -> None:
    histogram = LatencyHistogram()
    assert histogram.quantile_ns(0.5) == 0.0
    assert histogram.mean_ns == 0.0
    histogram.add(-5)
    assert histogram.quantile_ns(0.5) == 0.0
