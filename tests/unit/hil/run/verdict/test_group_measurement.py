"""Measurements between vehicles: the least distance and the formation, from states with known answers."""

from __future__ import annotations

import math

import pytest

from hil.config.group_schema import Group
from hil.run.verdict.group import GroupMeasurement
from signals.samples import TruthState, Vec3
from sim.physics.vehicle_group import VehicleContact

TICK_NS = 4_000_000


def state(tick: int, p_WB: Vec3, *, standing: bool = False) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    return TruthState(tick, tick * TICK_NS, p_WB, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), standing)


def test_the_distance_counts_while_one_of_two_is_in_the_air() -> None:
    measured = GroupMeasurement(["a", "b"])
    measured.add([state(0, (0, 0, 0), standing=True), state(0, (1, 0, 0), standing=True)])
    assert measured.min_distance_m is None
    measured.add([state(1, (0, 0, 2)), state(1, (1, 0, 0), standing=True)])
    assert measured.min_distance_m == pytest.approx(math.sqrt(5.0))
    rows, reasons = measured.verdict(Group(min_distance_m=3.0), None)
    assert rows[0].value == pytest.approx(math.sqrt(5.0))
    assert reasons == ["min_distance_m is 2.24 m, at least 3 m: a and b at 0.00 s"]


def test_a_vehicle_whose_flight_is_over_is_an_obstacle_to_those_that_fly() -> None:
    measured = GroupMeasurement(["a", "b", "c"])
    measured.add([state(0, (0, 0, 9)), state(0, (4, 0, 9)), state(0, (50, 0, 9))], [False] * 3)
    measured.add([state(1, (0, 0, 9)), state(1, (1, 0, 0), standing=True), state(1, (50, 0, 9))], [False, True, False])
    assert measured.min_distance_m == 4.0
    measured.add([state(2, (49, 0, 9)), state(2, (1, 0, 0), standing=True), state(2, (50, 0, 9))], [False, True, False])
    assert measured.min_distance_m == 1.0
    measured.add([state(3, (9, 0, 9))] * 3, [True, True, False])
    early, ending, late = (VehicleContact(t * TICK_NS, "a", "b", 2.0, 1.0, (1, 0, 0)) for t in (1, 2, 3))
    measured.contacts = [early, ending, late]
    rows, reasons = measured.verdict(Group(), None)
    assert rows[-1].value == 2.0  # `late` began when both flights were over
    assert reasons == ["a and b touched at 0.00 s, closing at 2.0 m/s, impulse 1.00 N s"]
    measured.contacts = [late]
    assert measured.verdict(Group(), None)[1] == []


def test_the_formation_is_measured_from_forming_to_the_first_end() -> None:
    share = 0.0
    measured = GroupMeasurement(
        ["a", "b"], offsets_W_m={"a": (0, 0, 0), "b": (0, 5, 0)}, formed_m=1.0, flown_share=lambda: share
    )
    for tick, y in enumerate((20.0, 5.5, 5.2, 5.8, 5.1)):
        measured.add([state(10 * tick, (0, 0, 9)), state(10 * tick, (0, y, 9))])
    share = 1.0
    measured.add([state(50, (0, 0, 9)), state(50, (0, 20, 9))])
    rows, reasons = measured.verdict(Group(), 0.5)
    assert rows[1].value == pytest.approx(0.8)
    assert reasons == ["formation_error_m is 0.8 m, at most 0.5 m: b at 0.12 s"]


@pytest.mark.parametrize(("share", "late"), [(0.0, False), (0.5, False), (0.8, True)])
def test_a_formation_that_forms_late_fails(share: float, late: bool) -> None:
    """Two vehicles that met at the last but one waypoint passed."""
    measured = GroupMeasurement(
        ["a", "b"], offsets_W_m={"a": (0, 0, 0), "b": (0, 5, 0)}, formed_m=1.0, flown_share=lambda: share
    )
    for tick, y in enumerate((20.0, 5.5, 5.2)):
        measured.add([state(10 * tick, (0, 0, 9)), state(10 * tick, (0, y, 9))])
    rows, reasons = measured.verdict(Group(), 0.5)
    text = "formation_error_m was measured late: when all were in place, 80% of the waypoints of one were reached"
    assert reasons == ([f"{text}, more than 50%"] if late else [])
    assert rows[1].ok == (not late)
    assert measured.verdict(Group(), None)[1] == []


def test_a_formation_that_never_forms_fails() -> None:
    measured = GroupMeasurement(["a", "b"], offsets_W_m={"a": (0, 0, 0), "b": (0, 5, 0)}, formed_m=1.0)
    never = "formation_error_m was never measured, at most 1 m"
    measured.add([state(0, (0, 0, 0), standing=True), state(0, (0, 20, 9))])
    assert measured.verdict(Group(), 1.0)[1] == [f"{never}: a never took off"]
    assert measured.verdict(Group(), 1.0, {"a"})[1] == [f"{never}: a was lost before take-off"]
    measured.add([state(10, (0, 0, 9)), state(10, (0, 20, 0), standing=True)])
    assert measured.verdict(Group(), 1.0)[1] == [f"{never}: the vehicles were never all in the air"]
    for tick, y in ((20, 20), (30, 18), (40, 22)):
        measured.add([state(tick, (0, 0, 9)), state(tick, (0, y, 9))])
    best = "b was 13.0 m from its place at best while all were in the air"
    assert measured.verdict(Group(), 1.0)[1] == [f"{never}: {best}"]
