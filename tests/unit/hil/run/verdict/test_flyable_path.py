"""Path of a plane through the waypoints of a plan: arcs that touch the legs, circles, tangents."""

import math

import pytest

from hil.config.missions.path import Leg, LegKind
from hil.run.verdict.flyable_path import FlyablePath, Stop

LEG = Leg(LegKind.FLY, 0, (0.0, 0.0, 50.0), (1.0, 0.0, 50.0))
RADIUS = 50.0


def path(*places, loiters=None):
    loiters = loiters or {}
    return FlyablePath([Stop(place, loiters.get(i, 0.0), LEG) for i, place in enumerate(places)], RADIUS)


def test_a_right_angle_is_cut_by_the_arc_that_touches_both_legs():
    p = path((0.0, 0.0), (500.0, 0.0), (500.0, 500.0))
    middle = (450.0 + RADIUS * math.sin(math.pi / 4), 50.0 - RADIUS * math.cos(math.pi / 4))
    assert p.error_m(2, middle) == pytest.approx(0.0, abs=0.05)
    assert p.error_m(1, (250.0, 7.0)) == pytest.approx(7.0)
    assert p.error_m(2, (507.0, 250.0)) == pytest.approx(7.0)
    assert p.error_m(2, (520.0, -20.0)) == pytest.approx(math.hypot(20.0, 20.0))  # overshoot of the corner


def test_the_arc_shrinks_where_a_leg_is_too_short():
    p = path((0.0, 0.0), (40.0, 0.0), (40.0, 500.0))
    # Half of the leg of 40 m is left for the turn: radius 20 m.
    assert p.error_m(2, (20.0 + 20.0 * math.sin(0.5), 20.0 - 20.0 * math.cos(0.5))) == pytest.approx(0.0, abs=0.02)


def test_a_turn_back_may_be_flown_near_its_corner():
    p = path((0.0, 0.0), (500.0, 0.0), (0.0, 30.0))
    assert p.error_m(2, (560.0, 80.0)) == 0.0
    assert p.error_m(2, (100.0, 200.0)) > 100.0


@pytest.mark.parametrize("loiter", [80.0, -80.0])
def test_a_loiter_is_its_circle_and_is_left_on_the_tangent(loiter):
    p = path((0.0, 0.0), (300.0, 0.0), (300.0, 400.0), loiters={1: loiter})
    assert p.error_m(1, (380.0, 0.0)) == pytest.approx(0.0, abs=0.1)
    assert p.error_m(1, (300.0, 0.0)) == pytest.approx(0.0, abs=1e-9)  # on the way to its centre
    assert p.error_m(2, (300.0, -90.0)) == pytest.approx(10.0, abs=0.1)
    side = -80.0 if loiter > 0.0 else 80.0  # a clockwise circle is left northwards on its west side
    aside = math.acos(80.0 / 400.0)
    tangent = (300.0 + math.copysign(80.0 * math.sin(aside), side), 80.0 * math.cos(aside))
    way_on = ((tangent[0] + 300.0) / 2, (tangent[1] + 400.0) / 2)
    assert p.error_m(2, way_on) == pytest.approx(0.0, abs=0.01)


def test_without_legs_there_is_no_error():
    assert path((0.0, 0.0)).error_m(0, (5.0, 5.0)) is None
