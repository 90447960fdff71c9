"""Speeds that a plan commands, against flights of known speed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import pytest

from hil.config.missions.path import Leg, LegKind
from hil.config.schema import Limits
from hil.run.verdict.flight import FlightMeasurement, Measurements, judge
from signals.samples import TruthState

TICK_NS = 40_000_000
UP_M = 10.0
HOME = (0.0, 0.0, 0.0)
PLACES = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)]


def plan(speeds_mps: Sequence[float]) -> list[Leg]:
    points = [(x, y, UP_M) for x, y in PLACES]
    legs = [Leg(LegKind.CLIMB, 0, HOME, points[0])]
    for seq, ((a, b), speed_mps) in enumerate(zip(itertools.pairwise(points), speeds_mps, strict=True), start=1):
        legs.append(Leg(LegKind.FLY, seq, a, b, speed_mps=speed_mps))
    return legs


def fly(
    legs: Sequence[Leg], ways: Sequence[tuple[tuple[float, float], float]], limits: Limits | None = None, *,
    whole: bool = True, home: tuple[float, float] = (0.0, 0.0),
) -> Measurements:  # fmt: skip
    """Climb above home, then fly through places in straight lines, at a speed [m/s] each."""
    measurement, tick, here = FlightMeasurement(legs, limits, stride=1, whole=whole), 0, (*home, 0.0)
    for there, speed_mps in [((*home, UP_M), 2.0), *(((x, y, UP_M), v) for (x, y), v in ways)]:
        way_m = math.dist(here, there)
        count = max(1, round(way_m / speed_mps * 1e9 / TICK_NS))
        v_W = tuple((b - a) / way_m * speed_mps for a, b in zip(here, there, strict=True))
        for i in range(count):
            p_W = tuple(a + (b - a) * (i + 1) / count for a, b in zip(here, there, strict=True))
            truth = TruthState(
                tick=tick, t_ns=tick * TICK_NS, p_WB=p_W, q_WB=(1.0, 0.0, 0.0, 0.0), v_WB_W=v_W,  # type: ignore[arg-type]
                w_WB_B=HOME, a_WB_W=HOME, alpha_WB_B=HOME, rotor_speed_radps=(), in_contact=tick == 0,
            )  # fmt: skip
            measurement.add(truth)
            tick += 1
        here = there
    return measurement.result()


def at(*speeds_mps: float) -> list[tuple[tuple[float, float], float]]:
    """The ways to all places."""
    return list(zip(PLACES[1:], speeds_mps, strict=True))


@pytest.mark.parametrize(("flown_mps", "flown"), [(0.5, True), (2.9, True), (3.1, False), (8.0, False)])
def test_a_plan_is_flown_no_faster_than_it_commands(flown_mps: float, flown: bool) -> None:
    """A plan of 2 m/s passed at 8."""
    measured = fly(plan([2.0] * 3), at(*[flown_mps] * 3))
    assert measured.reached == 3
    assert measured.completed
    reasons = judge(measured, Limits()).reasons
    assert len(reasons) == (0 if flown else 1)
    text = f"the vehicle flew at {flown_mps:g} m/s on the way to waypoint 1, "
    assert all(reason.startswith(text) for reason in reasons)
    assert all(reason.endswith(" m ahead of the 3 m/s that are allowed; the plan commands 2 m/s") for reason in reasons)
    assert judge(measured, Limits(), outcome="any").status == "PASS"
    assert judge(measured, Limits(), outcome="aborted").status == "FAIL", "it was completed"


@pytest.mark.parametrize(("flown_mps", "flown"), [(11.5, True), (13.0, False)])
def test_the_margin_of_a_fast_plan_is_a_share(flown_mps: float, flown: bool) -> None:
    assert (fly(plan([10.0] * 3), at(*[flown_mps] * 3)).speed_missed == "") == flown


def test_a_plan_without_a_speed_or_for_a_companion_is_flown_at_any() -> None:
    assert not fly(plan([0.0] * 3), at(20.0, 20.0, 20.0)).speed_missed
    assert not fly(plan([2.0] * 3), at(20.0, 20.0, 20.0), whole=False).speed_missed


def test_only_the_legs_after_the_command_are_judged() -> None:
    legs = plan([0.0, 2.0, 8.0])
    assert not fly(legs, at(2.0, 2.0, 8.0)).speed_missed
    assert "at 8 m/s on the way to waypoint 2" in fly(legs, at(2.0, 8.0, 8.0)).speed_missed
    assert "at 11 m/s on the way to waypoint 3" in fly(legs, at(20.0, 2.0, 11.0)).speed_missed


def test_a_vehicle_brakes_after_the_command() -> None:
    """At the waypoint at which the plan lowers the speed it still has that of before."""
    legs = plan([8.0, 2.0, 2.0])
    _, (to_second, _), (to_third, _) = at(8.0, 2.0, 2.0)
    braking = [(PLACES[1], 8.0), ((60.0, 30.0), 7.0), (to_second, 2.0), (to_third, 2.0)]
    assert not fly(legs, braking).speed_missed
    again = [*braking[:2], (to_second, 3.5), (to_third, 2.0)]
    assert "at 3.5 m/s on the way to waypoint 2" in fly(legs, again).speed_missed
    assert "at 8 m/s on the way to waypoint 2" in fly(legs, at(8.0, 8.0, 2.0)).speed_missed, "it does not brake"


def test_the_way_to_the_place_of_the_take_off_belongs_to_no_leg() -> None:
    """From a start 40 m away, at the speed that the autopilot has before the command."""
    legs = plan([2.0] * 3)
    away = [leg._replace(start_W=(-40.0, 0.0, 0.0)) if leg.kind is LegKind.CLIMB else leg for leg in legs]
    assert not fly(away, [((0.0, 0.0), 5.0), *at(2.0, 2.0, 2.0)], home=(-40.0, 0.0)).speed_missed
    assert "waypoint 1" in fly(away, [((0.0, 0.0), 5.0), *at(4.0, 2.0, 2.0)], home=(-40.0, 0.0)).speed_missed


def test_a_gust_within_the_limit_is_no_speed() -> None:
    """For a second and a half 2 m/s over what is allowed: 3 m ahead."""
    gust = [((20.0, 0.0), 2.0), ((27.5, 0.0), 5.0), *at(2.0, 2.0, 2.0)]
    legs = plan([2.0] * 3)
    assert "waypoint 1" in fly(legs, gust, Limits()).speed_missed
    assert not fly(legs, gust, Limits(max_cross_track_m=3.5)).speed_missed
    assert not fly(legs, gust, Limits(max_cross_track_m=None)).speed_missed
    short = [((20.0, 0.0), 2.0), ((22.0, 0.0), 5.0), ((24.0, 0.0), 2.0), ((26.0, 0.0), 5.0), *at(2.0, 2.0, 2.0)]
    assert not fly(legs, short).speed_missed, "0.8 m each, and back between"
