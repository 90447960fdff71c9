"""Verdicts on flights of planes whose errors are known in closed form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from hil.config.missions.path import Leg, LegKind
from hil.config.schema import PlaneLimits
from hil.run.verdict.flyable_path import Stop
from hil.run.verdict.plane_flight import PlaneMeasurement, Stall, judge_plane
from hil.run.verdict.verdict import Verdict
from signals.samples import TruthState, Vec3

V_MPS, STALL_MPS, HEIGHT_M, STEP_NS = 18.0, 10.0, 30.0, 100_000_000
FIRST, SECOND, TOUCH = (600.0, 0.0, HEIGHT_M), (1200.0, 0.0, HEIGHT_M), (1800.0, 0.0, 0.0)
LEGS = [
    Leg(LegKind.CLIMB, 0, (0.0, 0.0, 0.0), (200.0, 0.0, HEIGHT_M)),
    Leg(LegKind.FLY, 1, (200.0, 0.0, HEIGHT_M), FIRST),
    Leg(LegKind.FLY, 2, FIRST, SECOND),
    Leg(LegKind.APPROACH, 3, SECOND, (1800.0, 0.0, HEIGHT_M)),
    Leg(LegKind.DESCENT, 3, (1800.0, 0.0, HEIGHT_M), TOUCH),
]
STOPS = [
    Stop((0.0, 0.0)),
    Stop((200.0, 0.0)),
    Stop((600.0, 0.0), 0.0, LEGS[1]),
    Stop((1200.0, 0.0), 0.0, LEGS[2]),
    Stop((1800.0, 0.0)),
]


def rolled(bank_deg: float) -> tuple[float, float, float, float]:
    half = 0.5 * math.radians(bank_deg)
    return (math.cos(half), math.sin(half), 0.0, 0.0)


def flown(
    *,
    speed: float = V_MPS,
    wind_W: Vec3 = (0.0, 0.0, 0.0),
    aside_m: float = 0.0,
    bank_deg: float = 0.0,
    sink_mps: float = 1.0,
    landing_bank_deg: float = 0.0,
    long_m: float = 0.0,
    nan_at_m: float = math.inf,
) -> Verdict:
    """Fly along x, `aside_m` beside it, land `long_m` beyond the place; one velocity, at `nan_at_m`, is no number."""
    measured = PlaneMeasurement(
        LEGS, STOPS, PlaneLimits(), radius_m=48.0, stall=Stall(STALL_MPS), wind_at=lambda: wind_W
    )
    end, dt_s = TOUCH[0] + long_m, STEP_NS * 1e-9
    x, tick, rest, broken = 0.0, 0, 0, False
    while rest < 30:
        down = x >= end
        up = 0.0 if down else max(1e-3, min(HEIGHT_M, 0.15 * x, (end - x) * sink_mps / speed))
        place: Vec3 = (min(x, end), aside_m if x > 100.0 else 0.0, up)
        level = 0.15 * x > HEIGHT_M and up == HEIGHT_M
        v: Vec3 = (0.0, 0.0, 0.0) if down else (speed, 0.0, -sink_mps if up < HEIGHT_M and x > 1200.0 else 0.0)
        if x >= nan_at_m and not broken:
            broken, v = True, (math.nan, 0.0, 0.0)
        bank = bank_deg if level else landing_bank_deg if x > 1200.0 else 0.0
        truth = TruthState(
            tick=tick, t_ns=tick * STEP_NS // 10, p_WB=place, q_WB=rolled(bank), v_WB_W=v, w_WB_B=(0.0, 0.0, 0.0),
            a_WB_W=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0), rotor_speed_radps=(), in_contact=down,
        )  # fmt: skip
        measured.add(truth)
        x, tick, rest = x + speed * dt_s, tick + 10, rest + down
    return judge_plane(measured, PlaneLimits(), outcome="complete")


def value(verdict: Verdict, name: str) -> float:
    (row,) = (row for row in verdict.rows if row.name == name)
    assert row.value is not None
    return float(row.value)


def test_a_clean_flight_passes_with_its_measurements() -> None:
    verdict = flown(aside_m=3.0, bank_deg=20.0)
    assert (verdict.status, verdict.reasons) == ("PASS", ())
    assert value(verdict, "max_cross_track_m") == pytest.approx(3.0)
    assert value(verdict, "airspeed_margin") == pytest.approx(V_MPS / STALL_MPS * math.sqrt(math.cos(math.radians(20))))
    assert value(verdict, "max_bank_deg") == pytest.approx(20.0)
    assert value(verdict, "touchdown_sink_mps") == pytest.approx(1.0)
    assert value(verdict, "touchdown_offset_m") == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ({"speed": 10.5}, "airspeed_margin"),
        ({"wind_W": (7.5, 0.0, 0.0)}, "airspeed_margin"),  # a tail wind is no airspeed
        ({"bank_deg": 65.0}, "max_bank_deg"),
        ({"aside_m": 26.0}, "max_cross_track_m"),
        ({"aside_m": 7.0}, "touchdown_offset_m"),
        ({"sink_mps": 2.5}, "touchdown_sink_mps"),
        ({"landing_bank_deg": 12.0}, "touchdown_bank_deg"),
        ({"long_m": 110.0}, "touchdown_error_m"),
        ({"nan_at_m": 700.0}, "airspeed_margin"),  # good values before and after do not hide it
    ],
)
def test_what_breaks_a_limit_fails_and_is_named(fault: dict[str, float], name: str) -> None:
    verdict = flown(**fault)  # type: ignore[arg-type]
    assert verdict.status == "FAIL"
    assert any(reason.startswith(name) for reason in verdict.reasons), verdict.reasons


@pytest.mark.parametrize("off_m", [0.0, 9.0, -9.0])
def test_gentle_slopes_have_heights_to_keep(off_m: float) -> None:
    """Legs whose ends differ by half a metre were not judged."""
    places = [(600.0 * i, 0.0, height) for i, height in enumerate((HEIGHT_M, HEIGHT_M + 4.0, HEIGHT_M, HEIGHT_M + 8.0))]
    legs = [Leg(LegKind.CLIMB, 0, (-200.0, 0.0, 0.0), places[0])]
    legs += [Leg(LegKind.FLY, i + 1, *ends) for i, ends in enumerate(itertools.pairwise(places))]
    stops = [Stop((-200.0, 0.0)), Stop(places[0][:2]), *(Stop(leg.end_W[:2], 0.0, leg) for leg in legs[1:])]
    limits = PlaneLimits()
    measured = PlaneMeasurement(legs, stops, limits, radius_m=48.0, stall=Stall(8.0), wind_at=lambda: (0.0, 0.0, 0.0))
    for tick in range(0, 10_000, 10):
        x = 0.2 * tick - 200.0
        up = np.interp(x, [-200.0, *(place[0] for place in places)], [0.0, *(place[2] + off_m for place in places)])
        measured.add(
            TruthState(
                tick=tick, t_ns=tick * STEP_NS // 10, p_WB=(x, 0.0, float(up)), q_WB=rolled(0.0),
                v_WB_W=(20.0, 0.0, 0.0), w_WB_B=(0.0, 0.0, 0.0), a_WB_W=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0),
                rotor_speed_radps=(), in_contact=tick == 0,
            )
        )  # fmt: skip
    verdict = judge_plane(measured, limits)
    assert measured.counts == (3, 3)
    assert value(verdict, "altitude_error_m") == pytest.approx(abs(off_m), abs=0.1)
    assert verdict.status == ("FAIL" if off_m else "PASS"), verdict.reasons


def test_a_flight_that_turns_home_early_says_how_far_it_came() -> None:
    measured = PlaneMeasurement(
        LEGS, STOPS, PlaneLimits(), radius_m=48.0, stall=Stall(STALL_MPS), wind_at=lambda: (0.0, 0.0, 0.0)
    )
    verdict = judge_plane(measured, PlaneLimits(), outcome="complete")
    assert verdict.status == "FAIL"
    assert verdict.reasons[0] == "reached 0 of 2 waypoints"
    assert any("was never measured" in reason for reason in verdict.reasons)


@pytest.mark.parametrize(
    ("lands_at_m", "reason"),
    [
        (1900.0, ""),
        (None, "the plan lands before waypoint 3, and the vehicle did not"),
        (800.0, "touched the ground at"),
    ],
)
def test_a_landing_in_the_middle_of_the_plan_is_flown(lands_at_m: float | None, reason: str) -> None:
    """Planned at 1800 m, between two waypoints; the plan ends in the air at 3000 m."""
    there = (3000.0, 0.0, HEIGHT_M)
    legs = [*LEGS, Leg(LegKind.CLIMB, 4, TOUCH, (2000.0, 0.0, HEIGHT_M))]
    legs.append(Leg(LegKind.FLY, 5, legs[-1].end_W, there))
    stops = [*STOPS, Stop(TOUCH[:2]), Stop((2000.0, 0.0)), Stop(there[:2], 0.0, legs[-1])]
    limits = PlaneLimits()
    measured = PlaneMeasurement(legs, stops, limits, radius_m=48.0, stall=Stall(8.0), wind_at=lambda: (0.0, 0.0, 0.0))
    x, rest, tick = 0.0, 0, 0
    while x < 3000.0:
        to_touch_m = math.inf if lands_at_m is None else abs(x - lands_at_m)
        down = x == lands_at_m and rest < 20
        up = 0.0 if down else max(1e-3, min(HEIGHT_M, 0.15 * x, 0.15 * to_touch_m))
        truth = TruthState(
            tick=tick, t_ns=tick * STEP_NS // 10, p_WB=(x, 0.0, up), q_WB=rolled(0.0), w_WB_B=(0.0, 0.0, 0.0),
            v_WB_W=(0.0 if down else 20.0, 0.0, 0.0), a_WB_W=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0),
            rotor_speed_radps=(), in_contact=down,
        )  # fmt: skip
        measured.add(truth)
        x, rest, tick = x + (0.0 if down else 2.0), rest + down, tick + 10
    verdict = judge_plane(measured, limits)
    assert measured.completed == (not reason)
    assert any(reason in each for each in verdict.reasons) if reason else not verdict.reasons, verdict.reasons
