"""Verdicts against flights whose errors are known in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.config.missions.path import ACCEPTANCE_RADIUS_M, Leg, LegKind
from hil.config.schema import Limits
from hil.run.verdict.flight import FlightMeasurement, Measurements, horizontal_distance_m, judge
from hil.run.verdict.verdict import Row
from signals.samples import TruthState, Vec3

HOME = (0.0, 0.0, 0.2)
TICK_NS = 4_000_000
CORNERS = [(0.0, 0.0), (40.0, 0.0), (40.0, 25.0), (0.0, 25.0), (0.0, 0.0)]
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def rectangle(height: float = 10.2) -> list[Leg]:
    points = [(x, y, height) for x, y in CORNERS]
    legs = [Leg(LegKind.CLIMB, 0, HOME, (0.0, 0.0, height))]
    before = (0.0, 0.0, height)
    for seq, point in enumerate(points, start=1):
        legs.append(Leg(LegKind.FLY, seq, before, point))
        before = point
    return [*legs, Leg(LegKind.DESCENT, 6, before, HOME)]


def along(points: Sequence[Vec3], *, step_m: float = 0.05) -> Iterator[Vec3]:
    """Points every `step_m` of a polyline, with its corners."""
    for a, b in itertools.pairwise(points):
        n = max(1, math.ceil(math.dist(a, b) / step_m))
        for i in range(n):
            yield tuple(p + (q - p) * i / n for p, q in zip(a, b, strict=True))  # type: ignore[misc]
    yield points[-1]


def flown(
    legs: Sequence[Leg],
    points: Sequence[Vec3],
    *,
    q_WB: tuple[float, ...] = UPRIGHT,
    sink: float = 0.7,
    limits: Limits | None = None,
) -> Measurements:
    """Fly through `points`; within a millimetre of the height of the start the vehicle touches the ground."""
    measurement = FlightMeasurement(legs, limits, stride=1, whole=True)
    path = [*along(points), *[points[-1]] * 300]
    for tick, p_WB in enumerate(path):
        down = p_WB[2] <= HOME[2] + 1e-3
        truth = TruthState(
            tick=tick, t_ns=tick * TICK_NS, p_WB=p_WB, q_WB=q_WB if down and tick > 300 else UPRIGHT,  # type: ignore[arg-type]
            v_WB_W=(0.0, 0.0, 0.0 if down else -sink), w_WB_B=(0.0, 0.0, 0.0), a_WB_W=(0.0, 0.0, 0.0),
            alpha_WB_B=(0.0, 0.0, 0.0), rotor_speed_radps=(), in_contact=down,
        )  # fmt: skip
        measurement.add(truth)
    return measurement.result()


def tour(
    corners: Sequence[tuple[float, float]], height: float = 10.2, end: tuple[float, float] = (0.0, 0.0)
) -> list[Vec3]:
    flight = [(x, y, height) for x, y in corners]
    return [HOME, (0.0, 0.0, height), *flight, (*end, height), (*end, HOME[2])]


@pytest.mark.parametrize("height", [1.7, 10.2])
@pytest.mark.parametrize(("drift_m", "status"), [(0.0, "PASS"), (0.9, "PASS"), (1.2, "FAIL")])
def test_a_hover_is_judged_by_its_distance_from_the_place(height: float, drift_m: float, status: str) -> None:
    above = (0.0, 0.0, height)
    legs = [
        Leg(LegKind.CLIMB, 0, HOME, above),
        Leg(LegKind.FLY, 1, above, above),
        Leg(LegKind.DESCENT, 2, above, HOME),
    ]
    measured = flown(legs, tour([(drift_m, 0.0), (0.0, 0.0)], height))
    assert measured.completed
    assert measured.max_cross_track_m == pytest.approx(drift_m, abs=1e-9)
    assert judge(measured, Limits()).status == status


def test_a_perfect_flight_passes_with_zeros() -> None:
    measured = flown(rectangle(), tour(CORNERS))
    assert (measured.waypoints, measured.reached, measured.completed, measured.landed) == (5, 5, True, True)
    assert measured.max_cross_track_m == pytest.approx(0.0, abs=1e-9)
    assert measured.altitude_error_m == pytest.approx(0.0, abs=1e-9)
    assert measured.final_error_m == 0.0
    assert measured.landing_speed_mps == pytest.approx(0.7)
    assert measured.landed_tilt_deg == pytest.approx(0.0)
    assert judge(measured, Limits()).status == "PASS"


@given(st.floats(0.0, 1.9), st.floats(-0.9, 0.9), st.floats(0.0, 3.0), st.floats(0.0, 2 * math.pi))
def test_known_offsets_are_measured(bulge: float, height: float, final: float, angle: float) -> None:
    """A kink of `bulge` in the middle of one side, all of it `height` too high, landed `final` away."""
    kinked = [CORNERS[0], CORNERS[1], (40.0 + bulge, 12.5), *CORNERS[2:]]
    end = (final * math.cos(angle), final * math.sin(angle))
    measured = flown(rectangle(), tour(kinked, 10.2 + height, end))
    assert measured.reached == 5
    assert measured.max_cross_track_m == pytest.approx(bulge, abs=1e-6)
    assert measured.altitude_error_m == pytest.approx(abs(height), abs=1e-9)
    assert measured.final_error_m == pytest.approx(final, abs=1e-9)
    verdict = judge(measured, Limits(max_cross_track_m=1.0, altitude_error_m=0.5, final_error_m=0.7))
    good = measured.max_cross_track_m <= 1.0 and measured.altitude_error_m <= 0.5 and measured.final_error_m <= 0.7
    assert verdict.status == ("PASS" if good else "FAIL")


def test_cut_corners_cost_what_they_cut() -> None:
    """A chord from 1.5 m before a right angle to 1.5 m behind it: its middle is 0.75 m from either leg."""
    cut = [(0.0, 0.0), (38.5, 0.0), (40.0, 1.5), (40.0, 25.0), (0.0, 25.0), (0.0, 0.0)]
    measured = flown(rectangle(), tour(cut))
    assert measured.reached == 5
    assert measured.max_cross_track_m == pytest.approx(0.75, abs=0.03)


def test_a_flight_that_may_be_off_its_leg_may_be_off_its_corner() -> None:
    """All of it 3.5 m to the east and 2.5 m too high, as a standalone receiver would have it."""
    shifted = tour([(x + 3.5, y) for x, y in CORNERS], 12.7)
    assert flown(rectangle(), shifted).reached == 1  # the first corner, on the climb
    limits = Limits(max_cross_track_m=4.0, altitude_error_m=3.0)
    measured = flown(rectangle(), shifted, limits=limits)
    assert measured.reached == 5
    assert measured.max_cross_track_m == pytest.approx(3.5, abs=1e-6)
    assert measured.altitude_error_m == pytest.approx(2.5, abs=1e-6)
    assert judge(measured, limits).status == "PASS"
    assert flown(rectangle(), shifted, limits=Limits(max_cross_track_m=None, altitude_error_m=None)).reached == 5


@pytest.mark.parametrize(
    ("turns", "flown_turns", "missed"),
    [
        (2.0, 2, ""),
        (-2.0, -2, ""),
        (2.0, 1, "the vehicle flew 1.00 turns about waypoint 1; the plan makes 2"),
        (2.0, -2, "the vehicle flew 0.00 turns about waypoint 1; the plan makes 2"),
        (1.0, 0, "the vehicle flew 0.00 turns about waypoint 1; the plan makes 1"),
    ],
)
def test_a_plan_circles_its_waypoint(turns: float, flown_turns: int, missed: str) -> None:
    """One that went on at once passed."""
    home, there = (0.0, 0.0, 10.2), (20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, home), Leg(LegKind.FLY, 1, home, there, turns=turns)]
    legs += [Leg(LegKind.FLY, 2, there, home), Leg(LegKind.DESCENT, 3, home, HOME)]
    angles = [math.pi - math.tau * flown_turns * k / 200 for k in range(201)]
    circle = [(20.0 + math.cos(angle), math.sin(angle), 10.2) for angle in angles]
    measured = flown(legs, [HOME, home, *circle, home, HOME])
    assert (measured.reached, measured.hold_missed, measured.completed) == (2, missed, not missed)


@pytest.mark.parametrize(
    ("down_m", "away_m", "reached"), [(10.0, 0.0, 2), (9.0, 0.0, 1), (0.0, 0.0, 1), (10.0, 4.0, 1)]
)
def test_a_plan_lands_in_its_middle(down_m: float, away_m: float, reached: int) -> None:
    """One that flew over its place of delivery passed, and one that landed there had an altitude error of 10 m."""
    home, there, on = (0.0, 0.0, 10.2), (40.0, 0.0, 10.2), (40.0, 30.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, home), Leg(LegKind.FLY, 1, home, there)]
    legs += [Leg(LegKind.DESCENT, 2, there, (40.0, 0.0, 0.2)), Leg(LegKind.CLIMB, 3, (40.0, 0.0, 0.2), there)]
    legs += [Leg(LegKind.FLY, 4, there, on), Leg(LegKind.DESCENT, 5, on, (40.0, 30.0, 0.2))]
    above, low = (40.0 - away_m, 0.0, 10.2), (40.0 - away_m, 0.0, 10.2 - down_m)
    measured = flown(legs, [HOME, home, there, above, low, low, above, there, on, (40.0, 30.0, 0.2)])
    assert (measured.reached, measured.completed) == (reached, reached == 2)
    reasons = judge(measured, Limits()).reasons
    if reached == 2:
        assert reasons == ()
    else:
        assert reasons[0] == "reached 1 of 2 waypoints; the plan lands before waypoint 2, and the vehicle did not"


def test_wide_limits_reach_no_waypoint_from_afar() -> None:
    wide = Limits(max_cross_track_m=900.0, altitude_error_m=900.0)
    up_and_down = [HOME, (0.0, 0.0, 10.2), HOME]
    assert flown(rectangle(), up_and_down, limits=wide).reached == 1
    low = [HOME, *((x, y, 40.0) for x, y in CORNERS), HOME]
    assert flown(rectangle(100.2), low, limits=wide).reached == 0
    assert flown(rectangle(60.2), low, limits=wide).reached == 5


def square(side_m: float, height: float = 3.2) -> list[Leg]:
    top = (0.0, 0.0, height)
    legs = [Leg(LegKind.CLIMB, 0, HOME, top)]
    for seq, (x, y) in enumerate([(side_m, 0.0), (side_m, side_m), (0.0, side_m), (0.0, 0.0)], start=1):
        legs.append(Leg(LegKind.FLY, seq, legs[-1].end_W, (x, y, height)))
    return [*legs, Leg(LegKind.DESCENT, 5, top, HOME)]


@pytest.mark.parametrize("limit_m", [3.0, 6.0, 10.0, 11.0, 900.0, None])
@pytest.mark.parametrize(("side_m", "at_m"), [(4.0, 0.0), (4.0, 2.0), (6.0, 3.0), (9.0, 4.5)])
def test_a_hover_flies_no_small_square_whatever_the_limit(side_m: float, at_m: float, limit_m: float | None) -> None:
    """It was reached 4 of 4, from the first corner or from the middle."""
    limits = Limits(max_cross_track_m=limit_m)
    hover = [HOME, (at_m, at_m, 3.2), (at_m, at_m, 0.2)]
    assert flown(square(side_m), hover, limits=limits).reached <= 1
    assert judge(flown(square(side_m), hover, limits=limits), limits).status == "FAIL"
    corners = [(side_m, 0.0), (side_m, side_m), (0.0, side_m)]
    assert flown(square(side_m), tour(corners, 3.2), limits=limits).reached == 4


@pytest.mark.parametrize(
    ("height", "flown_at_m", "reached"), [(10.2, 4.0, 0), (10.2, 6.0, 5), (3.2, 0.9, 0), (3.2, 6.7, 5)]
)
def test_without_a_limit_of_height_half_of_it_is_flown(height: float, flown_at_m: float, reached: int) -> None:
    """A flight at 4 m instead of 10 m passed, and one at 0.7 m over ground instead of 3 m."""
    low = tour(CORNERS, flown_at_m)
    limits = Limits(altitude_error_m=None)
    assert flown(rectangle(height), low, limits=limits).reached == reached
    assert judge(flown(rectangle(height), low, limits=limits), limits).status == ("PASS" if reached else "FAIL")


def test_short_legs_between_long_ones_are_judged_by_the_long_ones() -> None:
    """Lines of a survey 2 m apart, all of it flown 3.5 m to the east: as far off as it may be."""
    lines = [(0.0, 0.0), (0.0, 50.0), (2.0, 50.0), (2.0, 50.0), (2.0, 0.0), (4.0, 0.0), (4.0, 50.0)]
    legs = [Leg(LegKind.CLIMB, 0, HOME, (0.0, 0.0, 10.2))]
    for seq, (x, y) in enumerate(lines, start=1):
        legs.append(Leg(LegKind.FLY, seq, legs[-1].end_W, (x, y, 10.2)))
    east = tour([(x + 3.5, y) for x, y in lines], end=(7.5, 50.0))[:-1]
    assert flown(legs, east, limits=Limits(max_cross_track_m=4.0)).reached == 7


def test_a_hover_over_one_place_keeps_the_margin_of_its_limit() -> None:
    above = (0.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, above), Leg(LegKind.FLY, 1, above, above)]
    aside = [HOME, (3.5, 0.0, 0.2), (3.5, 0.0, 10.2)]
    assert flown(legs, aside, limits=Limits(max_cross_track_m=4.0)).reached == 1


def staying(stays: Sequence[tuple[Vec3, float]], legs: Sequence[Leg], holds_s: Sequence[float]) -> Measurements:
    """Fly by jumps to places and stay there for times [s], then touch down below the last one.

    `holds_s`: to wait at the waypoints; empty: no time to wait is judged.
    """
    waits_s = iter(holds_s or [30.0] * len(legs))
    legs = [leg._replace(wait_s=next(waits_s)) if leg.kind is LegKind.FLY else leg for leg in legs]
    measurement, tick, tick_ns = FlightMeasurement(legs, stride=1, whole=bool(holds_s)), 0, 100_000_000
    ground = (*stays[-1][0][:2], HOME[2])
    for p_WB, stay_s in [(HOME, 0.1), *stays, (ground, 1.0)]:  # type: ignore[list-item]
        for _ in range(round(stay_s * 10)):
            truth = TruthState(
                tick=tick, t_ns=tick * tick_ns, p_WB=p_WB, q_WB=UPRIGHT,  # type: ignore[arg-type]
                v_WB_W=(0.0, 0.0, 0.0), w_WB_B=(0.0, 0.0, 0.0), a_WB_W=(0.0, 0.0, 0.0),
                alpha_WB_B=(0.0, 0.0, 0.0), rotor_speed_radps=(), in_contact=p_WB[2] <= HOME[2],
            )  # fmt: skip
            measurement.add(truth)
            tick += 1
    return measurement.result()


@pytest.mark.parametrize(
    ("first_s", "away_s", "back_s", "missed"),
    [
        (28.2, 0.0, 0.0, ""),
        (27.8, 0.0, 0.0, "the vehicle was at waypoint 1 for 27.7 s; the plan waits there for 30 s, 28 s are enough"),
        (15.0, 9.0, 15.0, ""),  # a gust, and back again
        (1.0, 40.0, 1.0, "the vehicle was at waypoint 1 for 1.8 s; the plan waits there for 30 s, 28 s are enough"),
    ],
)
def test_a_plan_waits_at_its_waypoints(first_s: float, away_s: float, back_s: float, missed: str) -> None:
    """A hover of 30 s passed after a second."""
    here, there = (0.0, 0.0, 10.2), (20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, here), Leg(LegKind.FLY, 1, here, here), Leg(LegKind.FLY, 2, here, there)]
    legs.append(Leg(LegKind.DESCENT, 3, there, (20.0, 0.0, HOME[2])))
    flight = [(here, first_s), ((8.0, 0.0, 10.2), away_s), (here, back_s), (there, 1.0), (here, 60.0), (there, 1.0)]
    measured = staying(flight, legs, [30.0, 1.5])
    assert (measured.reached, measured.hold_missed) == (2, missed)
    assert measured.completed == (not missed)
    limits = Limits(max_cross_track_m=None, altitude_error_m=None)
    assert judge(measured, limits).reasons == ((missed,) if missed else ())
    assert judge(measured, limits, outcome="any").status == "PASS"
    assert staying(flight, legs, []).completed, "companions are not told of the time"


@pytest.mark.parametrize(
    ("stays", "error_m"),
    [
        ([(10.2, 30.0)], 0.0),
        ([(8.5, 6.0), (10.2, 24.0)], 0.0),  # it arrives
        ([(10.2, 29.0), (9.0, 3.0)], 0.0),  # it leaves
        ([(8.5, 30.0)], 1.7),
        ([(10.2, 15.0), (10.8, 1.0), (10.2, 14.0)], 0.6),
    ],
)
@pytest.mark.parametrize("hover", [True, False])
def test_a_wait_has_the_height_of_its_place(stays: list[tuple[float, float]], error_m: float, hover: bool) -> None:
    """A hover of 30 s, 1.7 m too low, passed: its height was bounded by the reach of the waypoint alone."""
    here, there = (0.0, 0.0, 10.2), (0.0 if hover else 20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, here), Leg(LegKind.FLY, 1, here, there)]
    legs.append(Leg(LegKind.DESCENT, 2, there, (*there[:2], HOME[2])))
    flight = [(here, 1.0), (there, 0.2), *(((*there[:2], up_m), stay_s) for up_m, stay_s in stays)]
    measured = staying(flight, legs, [30.0])
    assert (measured.reached, measured.hold_missed) == (1, "")
    assert measured.altitude_error_m == pytest.approx(error_m, abs=1e-9)


def test_a_wait_at_the_first_of_two_places_within_one_reach_is_none_at_the_second() -> None:
    """The second counts as reached while the vehicle waits 1.5 m below it."""
    low, high = (0.0, 0.0, 4.2), (0.0, 0.0, 5.7)
    legs = [Leg(LegKind.CLIMB, 0, HOME, low), Leg(LegKind.FLY, 1, low, low), Leg(LegKind.FLY, 2, low, high)]
    legs.append(Leg(LegKind.DESCENT, 3, high, HOME))
    measured = staying([(low, 29.0), (high, 25.0)], legs, [20.0, 20.0])
    assert (measured.reached, measured.hold_missed) == (2, "")
    assert measured.altitude_error_m == pytest.approx(0.0, abs=1e-9)


def test_a_wait_after_a_climb_that_overshot_begins_once_the_vehicle_is_back() -> None:
    here, there = (0.0, 0.0, 10.2), (20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, here), Leg(LegKind.FLY, 1, here, there)]
    legs.append(Leg(LegKind.DESCENT, 2, there, (*there[:2], HOME[2])))
    above, back = (*there[:2], 13.0), (*there[:2], 12.0)
    measured = staying([(here, 1.0), (there, 0.2), (above, 9.0), (back, 2.0), (there, 34.0)], legs, [40.0])
    assert measured.altitude_error_m == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("first_s", "away_s", "back_s", "missed"),
    [
        (31.0, 0.0, 0.0, "the vehicle was at waypoint 2 for 2.9 s; the plan waits there for 30 s, 28 s are enough"),
        (10.0, 5.0, 46.4, ""),  # a gust during the first wait, and back again
        (56.4, 0.0, 0.0, ""),
    ],
)
@pytest.mark.parametrize("apart_m", [0.0, 1.5])
def test_waits_within_one_reach_add_up(
    first_s: float, away_s: float, back_s: float, missed: str, apart_m: float
) -> None:
    """Two waits of 30 s, also by a jump, were flown after 31 s: the same seconds counted for both."""
    here, near, there = (0.0, 0.0, 10.2), (apart_m, 0.0, 10.2), (20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, here), Leg(LegKind.FLY, 1, here, here), Leg(LegKind.FLY, 2, here, near)]
    legs += [Leg(LegKind.FLY, 3, near, there), Leg(LegKind.DESCENT, 4, there, (20.0, 0.0, HOME[2]))]
    flight = [(near, first_s), ((0.0, 8.0, 10.2), away_s), (near, back_s), (there, 1.0), (near, 60.0), (there, 1.0)]
    measured = staying(flight, legs, [30.0, 30.0, 0.0])
    assert (measured.reached, measured.hold_missed, measured.completed) == (3, missed, not missed)


@pytest.mark.parametrize(("second_s", "missed"), [(28.4, ""), (5.0, "waypoint 2 for 4.9 s")])
def test_the_way_between_two_waits_counts_for_none(second_s: float, missed: str) -> None:
    here, there = (0.0, 0.0, 10.2), (20.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, here), Leg(LegKind.FLY, 1, here, here), Leg(LegKind.FLY, 2, here, there)]
    legs.append(Leg(LegKind.DESCENT, 3, there, (20.0, 0.0, HOME[2])))
    measured = staying([(here, 40.0), ((10.0, 0.0, 10.2), 60.0), (there, second_s)], legs, [30.0, 30.0])
    assert measured.completed is not bool(missed)
    assert missed in measured.hold_missed


def test_a_missed_waypoint_stops_the_count_and_fails() -> None:
    measured = flown(rectangle(), tour([CORNERS[0], (36.0, 0.0), (36.0, 25.0), CORNERS[3], CORNERS[4]]))
    assert measured.reached == 1
    assert not measured.completed
    assert measured.max_cross_track_m is not None
    assert measured.max_cross_track_m > 20.0
    verdict = judge(measured, Limits())
    assert verdict.status == "FAIL"
    assert "reached 1 of 5 waypoints" in verdict.reasons
    assert any(reason.startswith("max_cross_track_m is 25 m, more than the 1 m allowed") for reason in verdict.reasons)


def test_never_taking_off_fails_every_declared_limit() -> None:
    verdict = judge(flown(rectangle(), [HOME, HOME]), Limits())
    assert verdict.status == "FAIL"
    assert {row.name for row in verdict.rows if not row.ok} == set(Limits.model_fields)
    assert "final_error_m has a limit of 0.7 m but was never measured: the vehicle did not end on the ground" in (
        verdict.reasons
    )
    assert judge(flown([], [HOME, HOME]), Limits()).status == "PASS"  # no mission, nothing to fail


@pytest.mark.parametrize(
    ("top_m", "came_to_m", "status"),
    [(50.2, 5.0, "FAIL"), (50.2, 48.1, "FAIL"), (50.2, 48.3, "PASS"), (1.2, 0.6, "FAIL"), (1.2, 0.8, "PASS")],
)
def test_a_plan_of_a_take_off_alone_wants_its_height(top_m: float, came_to_m: float, status: str) -> None:
    top = (0.0, 0.0, top_m)
    plan = [Leg(LegKind.CLIMB, 0, HOME, top), Leg(LegKind.DESCENT, 1, top, HOME)]
    measured = flown(plan, [HOME, (0.0, 0.0, came_to_m), HOME])
    verdict = judge(measured, Limits())
    assert (verdict.status, measured.completed) == (status, status == "PASS")
    words = "the take-off was not finished: the vehicle stayed "
    assert [reason.startswith(words) for reason in verdict.reasons] == [True] * (status == "FAIL")


def test_hanging_in_the_air_is_no_landing() -> None:
    measured = flown(rectangle(), tour(CORNERS)[:-1])
    assert (measured.reached, measured.landed, measured.completed, measured.final_error_m) == (5, False, False, None)
    assert judge(measured, Limits()).status == "FAIL"


@pytest.mark.parametrize(("roll_deg", "tipped"), [(20.0, False), (40.0, True), (180.0, True)])
def test_tipping_over_after_landing(roll_deg: float, tipped: bool) -> None:
    half = math.radians(roll_deg) / 2
    measured = flown(rectangle(), tour(CORNERS), q_WB=(math.cos(half), math.sin(half), 0.0, 0.0))
    assert measured.landed_tilt_deg == pytest.approx(roll_deg)
    assert measured.tipped is tipped
    assert judge(measured, Limits()).status == ("FAIL" if tipped else "PASS")


def test_hard_landing() -> None:
    verdict = judge(flown(rectangle(), tour(CORNERS), sink=2.5), Limits())
    assert verdict.reasons == ("landing_speed_mps is 2.5 m/s, more than the 2 m/s allowed",)


def test_nan_fails() -> None:
    measurement = FlightMeasurement(rectangle(), stride=1)
    for tick, p_WB in enumerate(along(tour(CORNERS))):
        p = (p_WB[0], math.nan, p_WB[2]) if tick == 500 else p_WB
        zero = (0.0, 0.0, 0.0)
        measurement.add(TruthState(tick, tick * TICK_NS, p, UPRIGHT, zero, zero, zero, zero, (), False))
    measured = measurement.result()
    assert measured.max_cross_track_m is not None
    assert math.isnan(measured.max_cross_track_m)
    assert judge(measured, Limits()).status == "FAIL"


def test_sloping_legs_have_no_height_to_keep() -> None:
    top, far = (0.0, 0.0, 10.2), (30.0, 0.0, 15.2)
    legs = [
        Leg(LegKind.CLIMB, 0, HOME, top),
        Leg(LegKind.FLY, 1, top, far),
        Leg(LegKind.FLY, 2, far, (60.0, 0.0, 10.2)),
        Leg(LegKind.FLY, 3, (60.0, 0.0, 10.2), (90.0, 0.0, 10.2)),
    ]
    late = [HOME, top, far, (64.0, 0.0, 10.2), (90.0, 0.0, 10.2)]  # reaches its height 4 m late
    measured = flown(legs, late)
    assert measured.completed  # this plan ends in the air
    assert measured.altitude_error_m == pytest.approx(0.0, abs=1e-9)
    assert measured.final_error_m == pytest.approx(0.0)


@pytest.mark.parametrize("off_m", [0.0, 1.3, -1.3])
def test_gentle_slopes_have_heights_to_keep(off_m: float) -> None:
    """A survey over uneven ground, whose legs were not judged: 1.3 m too low passed with a limit of 0.5 m."""
    places = [(30.0 * i, 0.0, height) for i, height in enumerate((10.2, 10.4, 12.0, 12.0, 10.2))]
    legs = [Leg(LegKind.CLIMB, 0, HOME, places[0])]
    legs += [Leg(LegKind.FLY, i + 1, *ends) for i, ends in enumerate(itertools.pairwise(places))]
    flight = [HOME, *((x, y, z + off_m) for x, y, z in places)]
    measured = flown(legs, flight)
    assert measured.reached == len(legs) - 1
    assert measured.altitude_error_m == pytest.approx(abs(off_m), abs=0.01)
    assert judge(measured, Limits()).status == ("FAIL" if off_m else "PASS")
    at_once = [HOME, *((x, y, max(z, after[2])) for (x, y, z), after in itertools.pairwise(places)), places[-1]]
    assert flown(legs, at_once).altitude_error_m == pytest.approx(0.0, abs=0.01), "autopilots climb in their own ways"


def sloping_plan(*places: Vec3, radius_m: float = ACCEPTANCE_RADIUS_M) -> list[Leg]:
    legs = [Leg(LegKind.CLIMB, 0, HOME, places[0])]
    return legs + [Leg(LegKind.FLY, i + 1, *ends, radius_m) for i, ends in enumerate(itertools.pairwise(places))]


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_height_that_is_reached_late_is_no_error(up: float) -> None:
    """Autopilots change the height along a leg, at its start, or at its end: five metres after it they have it."""
    high = 20.0 + 4.0 * up
    places: list[Vec3] = [(0.0, 0.0, 20.0), (60.0, 0.0, 20.0), (120.0, 0.0, high), (200.0, 0.0, high)]
    for late in ([(118.0, 0.0, 20.0), (124.9, 0.0, high)], [(120.0, 0.0, high - 0.9 * up), (124.9, 0.0, high)]):
        measured = flown(sloping_plan(*places), [HOME, *places[:2], *late, places[3]])
        assert measured.reached == 3
        assert measured.altitude_error_m == pytest.approx(0.0, abs=0.01)
    measured = flown(sloping_plan(*places), [HOME, *places[:2], (130.0, 0.0, high - up), places[3]])
    assert measured.altitude_error_m == pytest.approx(1.21, abs=0.02), "after that it is one"


@pytest.mark.parametrize("radius_m", [2.0, 10.0])
@pytest.mark.parametrize("leg_m", [3.0, 5.0, 30.0])
def test_a_flight_on_the_line_has_no_error_of_height(leg_m: float, radius_m: float) -> None:
    """However far the count is ahead of the vehicle, and with a steep leg among the others."""
    heights = (20.0, 20.0, 20.0 + 0.2 * leg_m, 20.0 + 0.21 * leg_m, 20.0 + 0.3 * leg_m, 20.0 + 0.3 * leg_m)
    places = [(leg_m * i, 0.0, height) for i, height in enumerate(heights)]
    measured = flown(sloping_plan(*places, radius_m=radius_m), [HOME, *places])
    assert measured.altitude_error_m in (None, pytest.approx(0.0, abs=0.01))


def test_height_counts_from_five_metres_of_level_flight_on() -> None:
    top, far = (0.0, 0.0, 15.2), (30.0, 0.0, 10.2)
    legs = [
        Leg(LegKind.CLIMB, 0, HOME, top),
        Leg(LegKind.FLY, 1, top, far),
        Leg(LegKind.FLY, 2, far, (60.0, 0.0, 10.2)),
    ]
    measured = flown(legs, [HOME, top, (30.0, 0.0, 11.2), (40.0, 0.0, 10.2), (60.0, 0.0, 10.2)])
    assert measured.altitude_error_m == pytest.approx(
        0.5, abs=0.006
    )  # 0.1 m a metre, 5 m before its end; steps of 5 cm


@pytest.mark.parametrize(
    ("way", "reasons"),
    [
        ([], ()),
        ([(30.0, 30.0, 10.2)], ("max_cross_track_m is 30 m, more than the 1 m allowed",)),
        ([(30.0, 0.0, 6.2)], ()),
        ([(30.0, 0.0, 4.2)], ("altitude_error_m is 6 m, more than the 0.5 m allowed",)),
        ([(57.5, 0.0, 10.2), (57.5, 0.0, 4.0)], ()),  # comes down within reach of the place
    ],
)
def test_the_way_to_a_landing_elsewhere_is_measured(way: list[Vec3], reasons: tuple[str, ...]) -> None:
    """Behind the last waypoint a vehicle could fly anywhere."""
    top, end = (0.0, 0.0, 10.2), (60.0, 0.0, 0.2)
    last, above = (0.0, -20.0, 10.2), (60.0, 0.0, 10.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, last), Leg(LegKind.FLY, 1, last, top), Leg(LegKind.APPROACH, 2, top, above)]
    landing = [] if len(way) > 1 else [above]
    measured = flown([*legs, Leg(LegKind.DESCENT, 2, above, end)], [HOME, last, top, *way, *landing, end])
    assert judge(measured, Limits()).reasons == reasons


def test_a_flight_that_returns_from_a_steep_leg_or_its_end_was_not_too_high() -> None:
    """Scripts that abort a plan let the vehicle climb for the way home, or land where it is."""
    top, far, above = (0.0, 0.0, 10.2), (40.0, 0.0, 25.2), (90.0, 0.0, 25.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, top), Leg(LegKind.FLY, 1, top, top), Leg(LegKind.FLY, 2, top, far)]
    legs += [Leg(LegKind.APPROACH, 3, far, above), Leg(LegKind.DESCENT, 3, above, (90.0, 0.0, 0.2))]
    middle, high = (20.0, 0.0, 17.7), (20.0, 0.0, 60.2)
    returned = flown(legs, [HOME, top, middle, high, (0.0, 0.0, 60.2), HOME])
    landed = flown(legs, [HOME, top, far, (40.0, 0.0, 0.2)])
    assert (returned.reached, landed.reached) == (1, 2)
    assert returned.altitude_error_m is None
    assert landed.altitude_error_m is None


@pytest.mark.parametrize(
    ("middle", "error_m"),
    [
        ([], None),
        ([(40.0, 0.0, 10.2)], None),  # climbs late
        ([(0.0, 0.0, 25.2)], None),  # climbs at once
        ([(20.0, 0.0, 30.1)], None),  # the count may be ahead by twice the reach
        ([(20.0, 0.0, 30.4)], 5.2),
        ([(20.0, 0.0, 4.0)], 6.2),
        ([(20.0, 0.0, 60.2)], 35.0),
    ],
)
def test_a_steep_leg_is_flown_between_the_heights_of_its_ends(middle: list[Vec3], error_m: float | None) -> None:
    """One that was flown at 60 m passed."""
    top, far, end = (0.0, 0.0, 10.2), (40.0, 0.0, 25.2), (40.0, 0.0, 0.2)
    legs = [Leg(LegKind.CLIMB, 0, HOME, top), Leg(LegKind.FLY, 1, top, top), Leg(LegKind.FLY, 2, top, far)]
    measured = flown([*legs, Leg(LegKind.DESCENT, 3, far, end)], [HOME, top, *middle, far, end])
    assert measured.completed
    assert "altitude_error_m" not in measured.called_for
    assert measured.altitude_error_m == (None if error_m is None else pytest.approx(error_m))
    assert judge(measured, Limits()).status == ("PASS" if error_m is None else "FAIL")


@pytest.mark.parametrize(("slope_m", "judged"), [(0.04, True), (2.9, True), (3.1, False)])
def test_a_leg_is_level_below_a_tenth_of_its_length(slope_m: float, judged: bool) -> None:
    top, far = (0.0, 0.0, 10.2), (30.0, 0.0, 10.2 + slope_m)
    legs = [Leg(LegKind.CLIMB, 0, HOME, top), Leg(LegKind.FLY, 1, top, far)]
    assert (flown(legs, [HOME, top, far]).altitude_error_m is not None) is judged


def test_one_waypoint_is_measured_on_the_way_to_it() -> None:
    top, far = (0.0, 0.0, 10.2), (30.0, 0.0, 10.2)
    legs = [
        Leg(LegKind.CLIMB, 0, HOME, top),
        Leg(LegKind.FLY, 1, top, far),
        Leg(LegKind.DESCENT, 2, far, (30.0, 0.0, 0.2)),
    ]
    measured = flown(legs, [HOME, top, (15.0, 1.2, 10.5), far, (30.0, 0.0, 0.2)])
    assert measured.max_cross_track_m == pytest.approx(1.2, abs=1e-3)
    assert measured.altitude_error_m == pytest.approx(0.3, abs=1e-3)
    assert measured.completed


POINT = st.tuples(*[st.floats(-100, 100)] * 3)


@given(POINT, POINT, POINT)
def test_distance_to_a_leg_is_the_least_of_the_distances_to_its_points(p: Vec3, a: Vec3, b: Vec3) -> None:
    distance = horizontal_distance_m(p, Leg(LegKind.FLY, 0, a, b))
    sampled = min(math.hypot(p[0] - a[0] - s * (b[0] - a[0]), p[1] - a[1] - s * (b[1] - a[1])) for s in
                  (i / 400 for i in range(401)))  # fmt: skip
    spacing = math.hypot(b[0] - a[0], b[1] - a[1]) / 400
    assert sampled - spacing - 1e-9 <= distance <= sampled + 1e-9


def test_a_stride_of_ten_ticks_finds_the_touch_down_of_any_tick() -> None:
    measurement = FlightMeasurement(rectangle(), stride=10)
    zero = (0.0, 0.0, 0.0)
    for tick in range(200):
        down = tick >= 103
        p = (0.0, 0.0, HOME[2] if down or tick < 10 else 5.0)
        v = (0.0, 0.0, 0.0 if down else -1.0 - 0.001 * tick)
        measurement.add(TruthState(tick, tick * TICK_NS, p, UPRIGHT, v, zero, zero, zero, (), down or tick < 10))
    assert measurement.result().landing_speed_mps == pytest.approx(1.102)


def test_doubled_and_close_waypoints_do_not_hide_the_leg_that_is_flown() -> None:
    corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 0.0), (40.0, 0.0), (40.0, 0.5), (40.0, 25.0)]
    legs = [Leg(LegKind.CLIMB, 0, HOME, (0.0, 0.0, 10.2))]
    for seq, (x, y) in enumerate(corners, start=1):
        legs.append(Leg(LegKind.FLY, seq, legs[-1].end_W, (x, y, 10.2)))
    measured = flown(legs, tour(corners, end=corners[-1])[:-2])
    assert (measured.waypoints, measured.reached) == (6, 6)
    assert measured.max_cross_track_m == pytest.approx(0.0, abs=1e-9)


def test_a_mission_that_never_ends_fails_however_well_it_is_flown() -> None:
    legs = rectangle()[:-1]
    legs.append(Leg(LegKind.ENDLESS, 7, legs[-1].end_W, legs[-1].end_W))
    measured = flown(legs, tour(CORNERS)[:-1])
    assert (measured.reached, measured.completed) == (5, False)
    verdict = judge(measured, Limits())
    assert verdict.status == "FAIL"
    assert verdict.reasons == ("the mission never ends: item 8 jumps back for ever",)


def test_a_row_without_a_value_is_neither_ok_nor_failed() -> None:
    """`ok: true` beside `value: null` told readers of an ERROR's run.json that a limit was kept."""
    assert Row("a_m", None, 1.0, "m", ok=True).as_map()["ok"] is None
    assert Row("a_m", None, 1.0, "m", ok=False).as_map()["ok"] is False
    assert Row("a_m", 0.5, None, "m", ok=True).as_map() == {
        "name": "a_m", "value": 0.5, "limit": None, "unit": "m", "ok": True
    }  # fmt: skip
