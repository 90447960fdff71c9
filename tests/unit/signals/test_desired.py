"""Desired states: what is kept, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from signals.desired import DesiredState, Knot, extrapolated

LEVEL = (1.0, 0.0, 0.0, 0.0)


def test_numbers_become_plain_floats_and_the_quaternion_a_unit_one() -> None:
    desired = DesiredState(p_W=np.float32([1, 2, 3]), q_WB=[0.9999, 0, 0, 0], thrust=None, yaw_rate_radps=np.int64(1))
    assert desired.p_W == (1.0, 2.0, 3.0)
    assert [type(c) for c in desired.p_W] == [float] * 3
    assert desired.q_WB == LEVEL
    assert desired.yaw_rate_radps == 1.0
    assert desired == DesiredState(p_W=(1, 2, 3), q_WB=LEVEL, yaw_rate_radps=1)


@pytest.mark.parametrize(
    ("fields", "moves"),
    [
        ({}, False),
        ({"yaw_rad": 1.0}, False),
        ({"q_WB": LEVEL}, False),
        ({"land": True}, False),
        ({"v_W": (0, 0, 0)}, True),
        ({"q_WB": LEVEL, "thrust": 0.0}, True),
        ({"w_B": (0, 0, 1), "thrust": 1.0}, True),
    ],
)
def test_some_desired_states_move_the_vehicle_and_others_do_not(fields: dict[str, Any], moves: bool) -> None:
    assert DesiredState(**fields).moves is moves


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"p_W": (0, 0)}, "p_W has 2 numbers"),
        ({"v_W": (0, 0, math.nan)}, "v_W .* finite"),
        ({"a_W": (0, math.inf, 0)}, "a_W .* finite"),
        ({"p_W": "abc"}, "p_W"),
        ({"p_W": 3.0}, "p_W"),
        ({"yaw_rad": math.nan}, "yaw_rad"),
        ({"yaw_rad": "east"}, "yaw_rad"),
        ({"q_WB": (1, 1, 0, 0)}, "norm 1.41"),
        ({"q_WB": LEVEL, "thrust": 1.01}, "0 to 1"),
        ({"q_WB": LEVEL, "thrust": -0.01}, "0 to 1"),
        ({"w_B": (0, 0, 0)}, "without thrust"),
        ({"thrust": 0.5}, "without q_WB or w_B"),
        ({"q_WB": LEVEL, "thrust": 0.5, "p_W": (0, 0, 1), "yaw_rad": 0}, "thrust with p_W, yaw_rad"),
        ({"land": 1}, "land"),
        ({"hold": "yes"}, "hold"),
        ({"p_W": (0, 0, 0), "ahead": ((0.1, (0, 0, 0), (0, 0, 0)),)}, "without p_W and v_W"),
        ({"p_W": (0, 0, 0), "v_W": (0, 0, 0), "ahead": ((1e-200, (1, 0, 0), (0, 0, 0)),)}, "times rise"),
        ({"p_W": (0, 0, 0), "v_W": (0, 0, 0), "ahead": ((0.0, (0, 0, 0), (0, 0, 0)),)}, "times rise"),
        ({"p_W": (0, 0, 0), "v_W": (0, 0, 0), "ahead": ((0.2, (0, 0, 0), (0, 0, 0)),) * 2}, "times rise"),
        ({"p_W": (0, 0, 0), "v_W": (0, 0, 0), "ahead": ((0.2, (0, 0), (0, 0, 0)),)}, "ahead has 2 numbers"),
        ({"p_W": (0, 0, 0), "v_W": (0, 0, 0), "ahead": ((9.0, (0, 0, 0), (0, 0, 0)),)}, "times rise"),
    ],
)
def test_what_cannot_be_flown_is_refused(fields: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        DesiredState(**fields)


def test_what_is_said_of_change_carries_a_desired_state_on_and_nothing_else_does() -> None:
    """A parabola, and a turn at a constant rate: carrying on twice is carrying on once for as long as both."""
    whole = DesiredState(p_W=(1, 2, 3), v_W=(4, -5, 6), a_W=(0.5, 1, -2), yaw_rad=1.0, yaw_rate_radps=-0.5)
    assert whole.changes
    later = extrapolated(whole, 0.4)
    assert later.p_W == pytest.approx((2.64, 0.08, 5.24))
    assert later.v_W == pytest.approx((4.2, -4.6, 5.2))
    assert (later.a_W, later.yaw_rate_radps, later.yaw_rad) == (whole.a_W, -0.5, pytest.approx(0.8))
    twice = extrapolated(extrapolated(whole, 0.15), 0.25)
    assert (twice.p_W, twice.v_W) == (pytest.approx(later.p_W), pytest.approx(later.v_W))
    for still in (
        DesiredState(p_W=(1, 2, 3), a_W=(1, 1, 1), yaw_rad=1.0),
        DesiredState(v_W=(1, 2, 3), yaw_rate_radps=1.0),
        DesiredState(q_WB=LEVEL, thrust=0.5),
        DesiredState(land=True),
    ):
        assert not still.changes
        assert extrapolated(still, 0.4) == still


def test_a_path_ahead_is_kept_to_a_cubic_exactly() -> None:
    """Hermite's cubic through position and velocity of both ends is the path itself where that is a cubic."""

    def path(t_s: float, k: int) -> tuple[float, float, float]:
        rows = ([1, 2, -3, 4], [0, -1, 0.5, 2], [5, 0, 1, -1])
        return tuple(float(np.polynomial.polynomial.polyval(t_s, np.polynomial.polynomial.polyder(r, k))) for r in rows)

    ahead = tuple(Knot(t_s, path(t_s, 0), path(t_s, 1)) for t_s in (0.2, 0.3, 0.7))
    desired = DesiredState(p_W=path(0.0, 0), v_W=path(0.0, 1), a_W=(9, 9, 9), ahead=ahead)
    for t_s in (0.0, 0.1, 0.2, 0.25, 0.6, 0.7):
        later = extrapolated(desired, t_s)
        assert later.ahead == ()
        for k, value in enumerate((later.p_W, later.v_W, later.a_W)):
            assert value == pytest.approx(path(t_s, k), abs=1e-9), (t_s, k)
    assert extrapolated(desired, 3.0) == extrapolated(desired, 0.7)  # as far as it is known
    short = DesiredState(p_W=(0, 0, 0), v_W=(1, 0, 0), ahead=(Knot(0.1, (0.2, 0, 0), (3, 0, 0)),))
    assert extrapolated(short, 0.3).p_W == pytest.approx((0.8, 0, 0))  # straight on behind the last
    assert extrapolated(short, 9.0).p_W == extrapolated(short, 0.5).p_W == pytest.approx((1.4, 0, 0))
