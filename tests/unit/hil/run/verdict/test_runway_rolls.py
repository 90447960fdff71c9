"""Rolls on a runway whose length and errors are known."""

from __future__ import annotations

import math

import pytest

from hil.run.verdict.runway_rolls import RunwayRolls
from signals.samples import TruthState, Vec3
from sim.scene.runway import Runway

RUNWAY = Runway(threshold_m=(-10.0, 0.0), heading_deg=90.0, length_m=400.0, width_m=18.0)
START = (0.0, 0.0, 0.2)


def truth(place: Vec3, *, contact: bool, speed_mps: float = 8.0) -> TruthState:
    return TruthState(
        tick=0, t_ns=0, p_WB=place, q_WB=(1.0, 0.0, 0.0, 0.0), v_WB_W=(speed_mps, 0.0, 0.0), w_WB_B=(0.0, 0.0, 0.0),
        a_WB_W=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0), rotor_speed_radps=(), in_contact=contact,
    )  # fmt: skip


def flown(*, aside_m: float = 0.0, stops_at_m: float = 180.0, lands: bool = True, start: Vec3 = START) -> RunwayRolls:
    """Roll 20 m with a hop, fly, touch down at x = 100 m, `aside_m` to the left of the line, and roll on."""
    rolls = RunwayRolls(RUNWAY, start_W=start, lands=lands)
    for x in range(13):
        rolls.add(truth((float(x), 0.3 * math.sin(x), 0.2), contact=True))
    rolls.add(truth((14.0, 0.0, 0.25), contact=False))  # a hop of 5 cm
    rolls.add(truth((20.0, 0.0, 0.2), contact=True))
    rolls.add(truth((60.0, 40.0, 30.0), contact=False))
    for x in range(100, round(stops_at_m) + 1):
        rolls.add(truth((float(x), aside_m, 0.2), contact=True))
    rolls.add(truth((stops_at_m, aside_m, 0.2), contact=True, speed_mps=0.0))
    return rolls


def test_lengths_and_centre_line() -> None:
    values = flown(aside_m=2.5).values()
    assert values == pytest.approx(
        {"takeoff_roll_m": 20.0, "landing_roll_m": 80.0, "centre_line_m": 2.5, "off_runway_m": 0.0}
    )


@pytest.mark.parametrize(
    ("change", "off_m"), [({"aside_m": 11.0}, 2.0), ({"stops_at_m": 397.0}, 7.0), ({"aside_m": -9.0}, 0.0)]
)
def test_it_says_how_far_off_the_runway_it_came(change: dict[str, float], off_m: float) -> None:
    assert flown(**change).values()["off_runway_m"] == pytest.approx(off_m)  # type: ignore[arg-type]


def test_what_is_not_on_the_runway_is_not_judged() -> None:
    elsewhere = flown(aside_m=30.0, lands=False)
    assert elsewhere.values()["off_runway_m"] == 0.0
    assert "landing_roll_m" not in elsewhere.called_for()
    launched = flown(start=(0.0, 50.0, 1.4))
    assert "takeoff_roll_m" not in launched.values()
    assert flown().called_for() == {"takeoff_roll_m", "landing_roll_m", "centre_line_m", "off_runway_m"}


def test_no_number_stays_no_number() -> None:
    rolls = RunwayRolls(RUNWAY, start_W=START, lands=False)
    rolls.add(truth((1.0, math.nan, 0.2), contact=True))
    rolls.add(truth((2.0, 0.0, 0.2), contact=True))
    assert math.isnan(rolls.values()["centre_line_m"])
