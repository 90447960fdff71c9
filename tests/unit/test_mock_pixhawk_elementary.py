"""Angles of the guidance: wrapping, Euler angles, and what happens to values that are no numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk import elementary as el
from hil.signals._kernel import roll_pitch_yaw


@given(st.floats(-1.0, 1.0))
def test_arc_sine_inverts_sine(x):
    assert math.isclose(el.asin(x), math.asin(x), rel_tol=1e-15, abs_tol=1e-300)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_sine_of_no_number_is_no_number(bad):
    assert math.isnan(el.sin(bad))
    assert math.isnan(el.cos(bad))


def test_wrapping_ends_for_any_number():
    assert abs(el.wrap_pi(1e30)) <= 1e15  # far beyond a double's precision: no direction, but no endless loop


@given(st.floats(-40.0, 40.0))
def test_wrapping_keeps_the_direction(angle):
    wrapped = el.wrap_pi(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-12)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-12)


@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_angles_of_the_quaternion_made_from_them(roll, pitch, yaw):
    half = [(math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw)]
    (cr, sr), (cp, sp), (cy, sy) = half
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    assert np.allclose(roll_pitch_yaw(q), (roll, pitch, yaw), atol=1e-6)
