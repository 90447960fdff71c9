"""Verdicts on flights of VTOLs whose phases and errors are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set

import pytest

from hil.config.missions.path import Leg, LegKind
from hil.config.missions.regimes import on_wings
from hil.config.schema import Limits, PlaneLimits
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import Stall
from hil.run.verdict.vtol_flight import Rotors, VtolMeasurement
from signals.mission import MissionItem
from signals.samples import TruthState, Vec3

STEP_NS = 100_000_000
ROTORS = Rotors((0, 1), (2,), (800.0, 800.0), (1000.0,))
LEGS = [
    Leg(LegKind.CLIMB, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 30.0)),
    Leg(LegKind.FLY, 1, (0.0, 0.0, 30.0), (400.0, 0.0, 30.0)),
    Leg(LegKind.APPROACH, 2, (400.0, 0.0, 30.0), (800.0, 0.0, 30.0)),
    Leg(LegKind.DESCENT, 2, (800.0, 0.0, 30.0), (800.0, 0.0, 0.0)),
]


def item(seq: int, command: int, param1: float = 0.0) -> MissionItem:
    return MissionItem(seq, 3, command, 0, 1, param1, 0.0, 0.0, 0.0, 0, 0, 30.0)


ITEMS = [item(0, 84), item(1, 16), item(2, 85)]


class Flight:
    """A flight in steps of 0.1 s."""

    def __init__(
        self,
        rotors: Rotors = ROTORS,
        *,
        legs: Sequence[Leg] = LEGS,
        items: Sequence[MissionItem] = ITEMS,
        wings: Set[int] = frozenset({1, 2}),
    ) -> None:
        self.measured = VtolMeasurement(
            legs,
            stops_of(legs, items),
            (PlaneLimits(), Limits()),
            rotors,
            wings=wings,
            radius_m=48.0,
            stall=Stall(10.0),
            wind_at=lambda: (0.0, 0.0, 0.0),
        )
        self.tick, self.p = 0, (0.0, 0.0, 0.0)

    def go(self, steps: int, v: Vec3, rotors: tuple[float, ...], tilts_deg: tuple[float, ...] = ()) -> None:
        angles = tuple(math.radians(angle) for angle in tilts_deg)
        x, y, z = self.p
        for _ in range(steps):
            x, y, z = x + 0.1 * v[0], y + 0.1 * v[1], max(z + 0.1 * v[2], 0.0)
            still = (0.0, 0.0, 0.0)
            contact = z == 0.0
            t_ns, level = self.tick * STEP_NS, (1.0, 0.0, 0.0, 0.0)
            moves = still if contact else v
            self.measured.add(
                TruthState(10 * self.tick, t_ns, (x, y, z), level, moves, still, still, still, rotors, contact, angles)
            )
            self.tick += 1
        self.p = (x, y, z)


HOVER, BOTH, WINGS = (800.0, 800.0, 0.0), (600.0, 600.0, 900.0), (0.0, 0.0, 700.0)


def flown(*, drift_mps: float = 0.0, loss_mps: float = 0.0, speed_mps: float = 15.0) -> dict[str, float | None]:
    flight = Flight()
    flight.go(5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    flight.go(100, (0.0, drift_mps, 3.0), HOVER)
    flight.go(50, (8.0, 0.0, -loss_mps), BOTH)
    flight.go(60, (speed_mps, 0.0, 0.0), WINGS)
    flight.go(10, (12.0, 0.0, 0.0), WINGS)
    flight.go(400, (15.0, 0.0, 0.0), WINGS)
    flight.go(40, (8.0, 0.0, 0.0), (500.0, 500.0, 0.0))
    flight.go(10, (1.0, 0.0, 0.0), HOVER)
    flight.go(400, (0.0, 0.0, -1.0), HOVER)
    return flight.measured.values()


def test_airspeed_counts_while_the_wings_carry_and_height_in_the_transition() -> None:
    values = flown()
    assert values["airspeed_margin"] == 1.2  # 12 m/s over 10, not the 8 m/s of the transitions
    assert values["transition_loss_m"] == 0.0
    assert values["hover_cross_track_m"] == 0.0
    assert values["landing_speed_mps"] == 1.0


def test_height_lost_in_the_transition() -> None:
    values = flown(loss_mps=0.5)
    assert abs((values["transition_loss_m"] or 0.0) - 2.45) < 0.06  # 4.9 s of the transition after its first tick


def test_drift_in_the_climb_counts_from_the_start() -> None:
    values = flown(drift_mps=0.2)
    # From the first judged height, 5 m, on: 8.3 of 10 s.
    assert abs((values["hover_cross_track_m"] or 0.0) - 1.66) < 0.1


@pytest.mark.parametrize(
    ("side_m", "flown_m", "reached"),
    [(4.0, 1.2, 0), (4.0, 1.6, 1), (4.0, 4.0, 2), (40.0, 36.8, 0), (40.0, 37.2, 1)],  # reach: 2.5 m of 4, 3 m of 40
)
def test_waypoints_in_hover_reach_as_far_as_a_multirotors(side_m: float, flown_m: float, reached: int) -> None:
    """A hop of 4 m was flown a metre after its start: 3 m counted, however short the leg."""
    start, corner, end = (0.0, 0.0, 30.0), (side_m, 0.0, 30.0), (side_m, side_m, 30.0)
    legs = [LEGS[0], Leg(LegKind.FLY, 1, start, corner), Leg(LegKind.FLY, 2, corner, end)]
    legs.append(Leg(LegKind.DESCENT, 3, end, (*end[:2], 0.0)))
    flight = Flight(legs=legs, items=[item(0, 22), item(1, 16), item(2, 16), item(3, 21)], wings=frozenset())
    flight.go(5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    flight.go(100, (0.0, 0.0, 3.0), HOVER)
    flight.go(round(10 * flown_m), (1.0, 0.0, 0.0), HOVER)
    if reached == 2:
        flight.go(round(10 * side_m), (0.0, 1.0, 0.0), HOVER)
    assert flight.measured.counts == (reached, 2)


def test_slow_on_the_wings() -> None:
    assert flown(speed_mps=9.0)["airspeed_margin"] == 0.9


def test_the_regime_of_the_items_of_a_plan() -> None:
    plan = [item(0, 22), item(1, 16), item(2, 3000, 3.0), item(3, 16), item(4, 3000, 4.0), item(5, 16), item(6, 85)]
    assert on_wings(plan, {}) == [False, True, True, False, False, True, True]
    assert on_wings(plan, {"NAV_FORCE_VT": 0})[:2] == [False, False]


# Two rotors in front on tilts, two behind that stop on the wings.
TILTING = Rotors((0, 1, 2, 3), (), (800.0,) * 4, (), ahead_rad=(0.5 * math.pi,) * 2, tilt_of=(0, None, 1, None))


def tilted(*, steering_deg: float = 0.0, on_the_way_deg: float = 45.0, rear_radps: float = 0.0) -> VtolMeasurement:
    """Fly as `flown`, with a transition that loses 2.45 m, on rotors that tilt."""
    flight, all_four = Flight(TILTING), (800.0,) * 4
    ahead, wings = (90.0, 90.0, 5.0), (700.0, rear_radps, 700.0, rear_radps)
    flight.go(5, (0.0, 0.0, 0.0), (0.0,) * 4, (0.0, 0.0, 0.0))
    flight.go(100, (0.0, 0.0, 3.0), all_four, (0.0, steering_deg, 0.0))
    flight.go(50, (8.0, 0.0, -0.5), all_four, (on_the_way_deg, on_the_way_deg, 0.0))
    flight.go(60, (15.0, 0.0, 0.0), wings, ahead)
    flight.go(410, (13.0, 0.0, 0.0), wings, ahead)
    flight.go(40, (8.0, 0.0, 0.0), all_four, (0.0, 0.0, 0.0))
    flight.go(10, (1.0, 0.0, 0.0), all_four, (0.0, 0.0, 0.0))
    flight.go(400, (0.0, 0.0, -1.0), all_four, (0.0, 0.0, 0.0))
    return flight.measured


def test_rotors_that_tilts_have_turned_ahead_do_not_lift() -> None:
    values = tilted().values()
    assert values["airspeed_margin"] == 1.3  # 13 m/s over 10 at full lift of none: the front rotors turn on the wings
    assert abs((values["transition_loss_m"] or 0.0) - 2.45) < 0.06
    assert values["hover_cross_track_m"] == 0.0


def test_rotors_that_lift_in_flight_are_no_flight_on_the_wings() -> None:
    assert tilted(rear_radps=600.0).values()["airspeed_margin"] is None


def test_one_tilt_that_steers_is_no_transition() -> None:
    assert tilted(steering_deg=30.0).values() == tilted().values()


def test_tilts_within_a_tenth_of_their_way_hover() -> None:
    assert (tilted(on_the_way_deg=8.0).values()["hover_cross_track_m"] or 0.0) > 39.0


@pytest.mark.parametrize(
    ("down_m", "wait_s", "missed"),
    [
        (30.0, 12.0, ""),
        (20.0, 12.0, "the plan lands before waypoint 2, and the vehicle did not"),
        (30.0, 25.0, "the plan waits there for 25 s, 23 s are enough"),
    ],
)
def test_waits_and_landings_in_hover_are_flown(down_m: float, wait_s: float, missed: str) -> None:
    there, end = (40.0, 0.0, 30.0), (80.0, 0.0, 30.0)
    ground = (40.0, 0.0, 0.0)
    legs = [
        LEGS[0],
        Leg(LegKind.FLY, 1, (0.0, 0.0, 30.0), there, wait_s=wait_s),
        Leg(LegKind.DESCENT, 2, there, ground),
    ]
    legs += [Leg(LegKind.CLIMB, 3, ground, there), Leg(LegKind.FLY, 4, there, end)]
    legs.append(Leg(LegKind.DESCENT, 5, end, (80.0, 0.0, 0.0)))
    items = [item(0, 22), item(1, 16), item(2, 21), item(3, 22), item(4, 16), item(5, 21)]
    flight = Flight(legs=legs, items=items, wings=frozenset())
    flight.go(5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    flight.go(100, (0.0, 0.0, 3.0), HOVER)
    flight.go(40, (10.0, 0.0, 0.0), HOVER)
    flight.go(111, (0.0, 0.0, 0.0), HOVER)
    flight.go(101, (0.0, 0.0, -0.1 * down_m), HOVER)
    flight.go(5, (0.0, 0.0, 0.0), HOVER)
    flight.go(100, (0.0, 0.0, 0.1 * down_m), HOVER)
    flight.go(40, (10.0, 0.0, 0.0), HOVER)
    flight.go(101, (0.0, 0.0, -3.0), HOVER)
    flight.go(5, (0.0, 0.0, 0.0), HOVER)
    assert flight.measured.unflown().endswith(missed)
    assert bool(flight.measured.unflown()) == bool(missed)
    assert flight.measured.completed == (not missed)
    if not missed:  # neither the way down nor the climb is an error of height
        assert (flight.measured.values()["altitude_error_m"] or 0.0) <= 1.0
