"""Bad flights of planes that look good at their waypoints: none may pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import pytest

from hil.config.missions.path import Leg, LegKind
from hil.config.schema import PlaneLimits
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import PlaneMeasurement, Stall, judge_plane
from hil.run.verdict.verdict import Verdict
from signals.mission import MissionItem
from signals.samples import TruthState, Vec3

SPEED_MPS, HEIGHT_M, RADIUS_M, DT_S = 18.0, 50.0, 80.0, 0.04
UP, HOME = (200.0, 0.0, HEIGHT_M), (0.0, 0.0, 0.0)


def plan(*items: tuple[LegKind, int, float, Vec3]) -> tuple[list[Leg], list[MissionItem]]:
    """Return legs and items of a take-off and (kind, command, param 1, place)."""
    legs, mission = [Leg(LegKind.CLIMB, 0, HOME, UP)], [MissionItem(0, 3, 22, 1, 1, 0, 0, 0, 0, 0, 0, 50)]
    for seq, (kind, command, param1, place) in enumerate(items, start=1):
        legs.append(Leg(kind, seq, legs[-1].end_W, place))
        mission.append(MissionItem(seq, 3, command, 0, 1, param1, 0, RADIUS_M, 0, 0, 0, place[2]))
    return legs, mission


def circle(centre: Vec3, turns: float, *, clockwise: bool = True) -> list[Vec3]:
    """Return points of a circle, from its west."""
    sign, count = (-1.0 if clockwise else 1.0), math.ceil(90 * turns)
    angles = [math.pi + sign * turns * math.tau * k / count for k in range(count + 1)]
    return [(centre[0] + RADIUS_M * math.cos(a), centre[1] + RADIUS_M * math.sin(a), centre[2]) for a in angles]


def along(points: Sequence[Vec3], speed_mps: float = SPEED_MPS) -> Iterator[tuple[Vec3, Vec3]]:
    """Yield places and velocities on a line through points."""
    for a, b in pairwise(points):
        length = math.dist(a, b)
        steps = max(1, round(length / speed_mps / DT_S))
        v = tuple((y - x) / (steps * DT_S) for x, y in zip(a, b, strict=True))
        for k in range(steps):
            s = k / steps
            yield (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])), (v[0], v[1], v[2])


def judged(
    legs: Sequence[Leg],
    items: Sequence[MissionItem],
    points: Sequence[Vec3],
    *,
    rests: bool = False,
    launched: bool = False,
    pitch_deg: float = 0.0,
    pitched_m: tuple[float, float] = (0.0, 0.0),
) -> Verdict:
    """Return the verdict on a flight through points; between two x it has another pitch."""
    limits = PlaneLimits(touchdown_sink_mps=2.5)
    measured = PlaneMeasurement(
        legs, stops_of(legs, items), limits, radius_m=48.0, stall=Stall(10.0, math.radians(15.0)),
        launched=launched, wind_at=lambda: (0.0, 0.0, 0.0),
    )  # fmt: skip
    flight = [*along(points), *([(points[-1], (0.0, 0.0, 0.0))] * 30 if rests else [])]
    for k, (place, v) in enumerate(flight):
        yaw = 0.5 * math.atan2(v[1], v[0])
        pitch = -0.5 * math.radians(pitch_deg if pitched_m[0] < place[0] < pitched_m[1] else 0.0)
        cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        q = (cy * cp, -sy * sp, cy * sp, sy * cp)
        truth = TruthState(
            tick=10 * k, t_ns=round(k * DT_S * 1e9), p_WB=place, q_WB=q, v_WB_W=v, w_WB_B=(0.0, 0.0, 0.0),
            a_WB_W=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0), rotor_speed_radps=(), in_contact=place[2] <= 0.0,
        )  # fmt: skip
        measured.add(truth)
    return judge_plane(measured, limits)


FIRST, CENTRE, LAST = (600.0, 0.0, HEIGHT_M), (1000.0, 0.0, HEIGHT_M), (1600.0, 0.0, HEIGHT_M)
FLY = LegKind.FLY


@pytest.mark.parametrize(
    ("command", "amount", "flown", "reason"),
    [
        (18, 2.0, 2.0, None),
        (18, 2.0, 1.8, None),  # an autopilot that began to count before the circle
        (18, 2.0, 1.0, "of 2 turns"),
        (18, 1.0, -1.0, "the wrong way round of 1 turns"),
        (19, 30.0, 1.1, None),
        (19, 60.0, 1.1, "of 60 s"),
        (18, 2.0, 0.0, "the loiter at waypoint 2 was not flown"),  # straight through the middle
    ],
)
def test_a_loiter_must_be_flown(command: int, amount: float, flown: float, reason: str | None) -> None:
    legs, items = plan((FLY, 16, 0, FIRST), (FLY, command, amount, CENTRE), (FLY, 16, 0, LAST))
    way = circle(CENTRE, abs(flown), clockwise=flown > 0) if flown else [CENTRE]
    verdict = judged(legs, items, [HOME, UP, FIRST, *way, LAST])
    about = [text for text in verdict.reasons if "not flown" in text or "waypoints" in text]
    if reason is None:
        assert about == []
    else:
        assert about[0] == "reached 2 of 3 waypoints"
        assert reason in about[1]


def test_a_loiter_at_the_end_must_be_flown_too() -> None:
    legs, items = plan((FLY, 16, 0, FIRST), (FLY, 18, 1.0, CENTRE))
    assert judged(legs, items, [HOME, UP, FIRST, *circle(CENTRE, 1.0)]).reasons == ()
    told = judged(legs, items, [HOME, UP, FIRST, *circle(CENTRE, 0.3)]).reasons
    assert told[0].startswith("the loiter at waypoint 2 was not flown: 0.3 turns")


def test_a_plane_that_touches_the_ground_on_the_way_has_not_flown_its_plan() -> None:
    sloping = (1000.0, 0.0, 40.0)
    legs, items = plan((FLY, 16, 0, FIRST), (FLY, 16, 0, sloping), (FLY, 16, 0, (1600.0, 0.0, 45.0)))
    way: list[Vec3] = [HOME, UP, FIRST, (800.0, 0.0, 0.0), (820.0, 0.0, 0.0), sloping, (1600.0, 0.0, 45.0)]
    reasons = judged(legs, items, way).reasons
    assert any(text.startswith("touched the ground at ") and "on the way to waypoint 2" in text for text in reasons)
    assert judged(legs, items, [HOME, UP, FIRST, sloping, (1600.0, 0.0, 45.0)]).reasons == ()


def test_a_launch_that_falls_to_the_ground_has_not_taken_off_but_wheels_may_bounce() -> None:
    legs, items = plan((FLY, 16, 0, FIRST), (FLY, 16, 0, LAST))
    way: list[Vec3] = [HOME, (10.0, 0.0, 1.5), (20.0, 0.0, 0.0), (22.0, 0.0, 0.0), FIRST, LAST]
    assert judged(legs, items, way).reasons == ()
    (reason,) = judged(legs, items, way, launched=True).reasons
    assert reason.startswith("touched the ground at 1.")
    assert reason.endswith("on the way to waypoint 1")


def test_a_bounce_counts_as_a_touch_down() -> None:
    legs, items = plan(
        (FLY, 16, 0, FIRST), (LegKind.APPROACH, 21, 0, LAST), (LegKind.DESCENT, 21, 0, (1600.0, 0.0, 0.0))
    )
    legs[-1] = legs[-1]._replace(seq=2)
    soft: list[Vec3] = [HOME, UP, FIRST, (1600.0, 0.0, 0.0), (1601.0, 0.0, 0.0)]
    assert judged(legs, items, soft, rests=True).reasons == ()
    bounced: list[Vec3] = [*soft[:-1], (1605.0, 0.0, 3.0), (1610.0, 0.0, 0.0), (1611.0, 0.0, 0.0)]
    (reason,) = judged(legs, items, bounced, rests=True).reasons
    assert reason.startswith("touchdown_sink_mps is 9")


def test_the_only_waypoint_is_not_reached_by_passing_it_far_off() -> None:
    legs, items = plan((FLY, 16, 0, FIRST))
    assert judged(legs, items, [HOME, UP, FIRST, LAST]).reasons == ()
    far: list[Vec3] = [HOME, UP, (600.0, 150.0, HEIGHT_M), (1600.0, 150.0, HEIGHT_M)]
    assert judged(legs, items, far).reasons == ("reached 0 of 1 waypoints",)


def test_a_stall_at_flying_speed_fails() -> None:
    legs, items = plan((FLY, 16, 0, FIRST), (FLY, 16, 0, LAST))
    way = [HOME, UP, FIRST, LAST]
    assert judged(legs, items, way, pitch_deg=14.0, pitched_m=(800.0, 900.0)).reasons == ()
    (reason,) = judged(legs, items, way, pitch_deg=17.0, pitched_m=(800.0, 818.0)).reasons
    assert reason.startswith("stalled_s is 1 s, more than the allowed 0.5 s")
    (inverted,) = judged(legs, items, way, pitch_deg=-17.0, pitched_m=(800.0, 818.0)).reasons
    assert inverted.startswith("stalled_s")


def test_a_return_lands_at_home() -> None:
    legs, items = plan(
        (FLY, 16, 0, FIRST), (LegKind.RETURN, 20, 0, (0.0, 0.0, HEIGHT_M)), (LegKind.DESCENT, 20, 0, HOME)
    )
    legs[-1] = legs[-1]._replace(seq=2)
    there: list[Vec3] = [HOME, UP, FIRST, (600.0, 100.0, HEIGHT_M), (50.0, 0.0, 0.0), (49.0, 0.0, 0.0)]
    assert judged(legs, items, there, rests=True).reasons == ()
    away: list[Vec3] = [HOME, UP, FIRST, (1600.0, 0.0, 0.0), (1601.0, 0.0, 0.0)]
    reasons = judged(legs, items, away, rests=True).reasons
    assert any(text.startswith("touchdown_error_m is 1.6e+03 m") for text in reasons), reasons


def test_the_amount_of_a_loiter_comes_from_its_item() -> None:
    legs, items = plan((FLY, 18, 3.0, FIRST), (FLY, 19, 25.0, CENTRE), (FLY, 16, 9.0, LAST), (FLY, 18, math.nan, FIRST))
    amounts = [(stop.turns, stop.time_s) for stop in stops_of(legs, items) if stop.leg is not None]
    assert amounts == [(3.0, 0.0), (0.0, 25.0), (0.0, 0.0), (1.0, 0.0)]


@pytest.mark.parametrize(("came_to_m", "missed"), [(15.0, True), (39.0, True), (41.0, False), (50.0, False)])
def test_a_plan_of_a_take_off_alone_wants_its_height(came_to_m: float, missed: bool) -> None:
    legs, items = plan((LegKind.DESCENT, 21, 0.0, (1200.0, 0.0, 0.0)))
    top = (400.0, 0.0, came_to_m)
    verdict = judged(legs, items, [HOME, top, (1200.0, 0.0, 0.0)], rests=True)
    assert any(reason.startswith("the take-off was not finished: ") for reason in verdict.reasons) is missed
