"""NPFG against the closed forms of its linearisation: an oscillator about a line, the acceleration of a circle."""

import math

import pytest

from firmware_bridge.mock_pixhawk.plane.npfg import PathPoint, lateral_acceleration_mps2, track_error_bound_m
from firmware_bridge.mock_pixhawk.plane.path import Circle, Line, line_between

G = 9.80665
NORTH = Line(0.0, 0.0, 1.0, 0.0)


def acceleration(path, ground, wind=(0.0, 0.0), period=10.0, damping=0.7):
    return lateral_acceleration_mps2(path, ground_mps=ground, wind_mps=wind, period_s=period, damping=damping)


def fly(path, *, n, e, course, speed=15.0, wind=(0.0, 0.0), seconds=60.0, period=10.0, damping=0.7, dt=0.005):
    """Return the errors of a point that turns as commanded: air velocity of constant size, drifting with the wind."""
    errors = []
    for _ in range(int(seconds / dt)):
        air = (speed * math.cos(course), speed * math.sin(course))
        ground = (air[0] + wind[0], air[1] + wind[1])
        at = path.nearest(n, e)
        errors.append(at.right_m)
        a = acceleration(at, ground, wind, period, damping)
        course += a / speed * dt
        n, e = n + ground[0] * dt, e + ground[1] * dt
    return errors


@pytest.mark.parametrize(("period", "damping"), [(10.0, 0.7), (8.0, 0.5), (15.0, 0.9)])
def test_near_a_line_the_error_is_an_oscillator_of_period_and_damping(period, damping):
    dt = 0.002
    errors = fly(NORTH, n=0.0, e=0.5, course=0.0, period=period, damping=damping, seconds=period, dt=dt)
    w = 2.0 * math.pi / period
    wd = w * math.sqrt(1.0 - damping**2)
    for k in range(0, len(errors), 50):
        t = k * dt
        exact = 0.5 * math.exp(-damping * w * t) * (math.cos(wd * t) + damping * w / wd * math.sin(wd * t))
        assert errors[k] == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("radius", [40.0, 80.0, 300.0])
def test_on_a_circle_it_asks_for_the_acceleration_of_the_circle(clockwise, radius):
    at = Circle(10.0, -20.0, radius, clockwise).nearest(10.0 + radius, -20.0)
    speed = 17.0
    ground = (at.t_n * speed, at.t_e * speed)
    expected = speed * speed / radius * (1.0 if clockwise else -1.0)
    assert acceleration(at, ground) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (4.0, -5.0)])
def test_a_circle_is_flown_in_wind(wind):
    circle = Circle(0.0, 0.0, 80.0, clockwise=True)
    errors = fly(circle, n=80.0, e=0.0, course=math.pi / 2, wind=wind, seconds=120.0, period=8.0)
    assert max(abs(e) for e in errors[len(errors) // 2 :]) < (0.02 if wind == (0.0, 0.0) else 3.0)


def test_a_line_is_held_in_cross_wind_with_the_crab_angle_of_the_wind_triangle():
    errors = fly(NORTH, n=0.0, e=60.0, course=0.0, wind=(0.0, 6.0), seconds=90.0)
    assert abs(errors[-1]) < 1e-3
    crab = -math.asin(6.0 / 15.0)
    air = (15.0 * math.cos(crab), 15.0 * math.sin(crab))
    at = PathPoint(1.0, 0.0, 0.0, 0.0)
    assert acceleration(at, (air[0], air[1] + 6.0), (0.0, 6.0)) == pytest.approx(0.0, abs=1e-12)


def test_far_from_a_line_it_flies_straight_at_it():
    bound = track_error_bound_m(15.0, 10.0, 0.7)
    assert bound == pytest.approx(105.0)
    at = NORTH.nearest(0.0, 2.0 * bound)
    assert acceleration(at, (0.0, -15.0)) == pytest.approx(0.0, abs=1e-12)  # already flying west at the line
    assert acceleration(at, (15.0, 0.0)) < 0.0  # turns left, towards it


def test_a_wind_above_the_airspeed_gives_a_number():
    value = acceleration(NORTH.nearest(0.0, 5.0), (0.0, 5.0), (0.0, 20.0))
    assert math.isfinite(value)
    assert acceleration(NORTH.nearest(0.0, 5.0), (0.0, 0.0)) == 0.0  # no airspeed, no command


def test_a_line_between_equal_places_keeps_the_course():
    line = line_between(3.0, 4.0, 3.2, 4.1, otherwise_rad=math.pi / 2)
    assert (line.t_n, line.t_e) == pytest.approx((0.0, 1.0), abs=1e-12)
    assert Circle(0.0, 0.0, 50.0, clockwise=False).nearest(0.0, 0.0).right_m == -50.0
