"""Costs of windows: what was put into them comes out, whatever the machine's moods."""

from __future__ import annotations

import numpy as np
import pytest

from hil.bench_suite.dash_windows import Spent, State, Windows


def windows(watched: float, beside: float, *, count: int = 60) -> Windows:
    """Windows of unlike lengths, each state so many times as long as alone but for noise of 3 %."""
    rng = np.random.Generator(np.random.Philox(key=7))
    spent = np.ones((len(State), count, len(Spent._fields)))
    length_s = rng.uniform(0.05, 0.5, count)
    for state, factor in ((State.ALONE, 1.0), (State.WATCHED, watched), (State.BESIDE, beside)):
        spent[state, :, 0] = spent[state, :, 1] = length_s * factor * np.exp(0.03 * rng.standard_normal(count))
    return Windows(spent, ("a", "a", "a"))


def test_the_cost_is_found_within_its_error() -> None:
    seen = windows(1.04, 1.2)
    for state, true in ((State.WATCHED, 0.04), (State.BESIDE, 0.2)):
        cost, error = seen.cost(state, "wall_s")
        assert abs(cost - true) < 3.0 * error
        assert 0.003 < error < 0.012  # 1.2533 x 3 % x sqrt(2 / 60) = 0.69 %


def test_a_few_disturbed_windows_move_it_little() -> None:
    seen = windows(1.04, 1.0)
    seen.of(State.WATCHED, "wall_s")[:6] *= 4.0  # a view: written to
    cost, error = seen.cost(State.WATCHED, "wall_s")
    assert abs(cost - 0.04) < 4.0 * error
    assert error < 0.02


def test_shares_are_of_the_time_in_that_state_alone() -> None:
    seen = windows(1.5, 1.0)
    seen.of(State.WATCHED, "updates")[:] = 21.0 * seen.of(State.WATCHED, "wall_s")
    assert seen.share("updates") == pytest.approx(21.0)
