"""Integer rates: exact on average, no drift, no early event."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.run.loop.scheduler import ReleaseQueue
from signals.samples import BaroSample
from signals.time import RateAccumulator, is_due, period_ns_from_hz


def due_ticks(event_hz: float, tick_hz: float, ticks: int) -> list[int]:
    rate = RateAccumulator(event_millihz=round(event_hz * 1000), tick_millihz=round(tick_hz * 1000))
    return [k for k in range(ticks) if rate.due()]


def test_100_hz_on_250_hz_is_100_hz_not_83() -> None:
    assert due_ticks(100, 250, 11) == [0, 3, 5, 8, 10]
    assert len(due_ticks(100, 250, 250_000)) == 100_000


@given(event=st.integers(1, 1_000_000), tick=st.integers(1, 1_000_000), ticks=st.integers(1, 3000))
def test_event_n_falls_on_the_first_tick_at_or_after_its_time(event: int, tick: int, ticks: int) -> None:
    if event > tick:
        with pytest.raises(ValueError, match="cannot be served"):
            RateAccumulator(event_millihz=event, tick_millihz=tick)
        return
    rate = RateAccumulator(event_millihz=event, tick_millihz=tick)
    due = [k for k in range(ticks) if rate.due()]
    # Event n is due at n/event s = tick number ceil(n * tick / event): closed form in integers.
    expected = []
    n = 0
    while (k := -(-n * tick // event)) < ticks:
        expected.append(k)
        n += 1
    assert due == expected
    assert [k for k in range(ticks) if is_due(k, event_millihz=event, tick_millihz=tick)] == expected
    stepped, k = [], 0
    rate = RateAccumulator(event_millihz=event, tick_millihz=tick)
    while k < ticks:
        stepped.append(k)
        k += 1 + rate.idle_ticks()
    assert stepped == expected


def test_period() -> None:
    assert period_ns_from_hz(250) == 4_000_000
    with pytest.raises(ValueError, match="above 0"):
        period_ns_from_hz(0)
    with pytest.raises(ValueError, match="above 0"):
        period_ns_from_hz(float("nan"))


def baro(seq: int, available: int) -> BaroSample:
    return BaroSample(seq, 0, available, 101325.0, 0.0, 15.0)


@given(st.lists(st.tuples(st.integers(0, 50), st.sampled_from("abc")), max_size=40))
def test_release_order_is_total_and_nothing_is_lost(pushes: list[tuple[int, str]]) -> None:
    queue = ReleaseQueue()
    for seq, (available, port) in enumerate(pushes):
        queue.push(port, baro(seq, available))
    released = []
    for t in range(0, 51, 5):
        batch = queue.release(t)
        assert all(s.t_available_ns <= t for _, s in batch)
        released += batch
    keys = [(s.t_available_ns, port, s.seq) for port, s in released]
    assert keys == sorted(keys)
    assert len(released) == len(pushes)
    assert len(queue) == 0
