"""Angles of the guidance."""

import math

from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk import elementary as el


def test_wrapping_ends_for_any_number():
    assert abs(el.wrap_pi(1e30)) <= 1e15  # far beyond a double's precision: no direction, but no endless loop


@given(st.floats(-40.0, 40.0))
def test_wrapping_keeps_the_direction(angle):
    wrapped = el.wrap_pi(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-12)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-12)
