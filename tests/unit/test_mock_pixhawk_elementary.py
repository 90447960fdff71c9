"""The guidance's elementary functions against the native ones, bit for bit, and against the C library."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk import elementary as el
from sim import _kernels as native

ANGLES = np.concatenate(
    [
        np.linspace(-20.0, 20.0, 4001),
        np.pi / 4 * np.arange(-40, 41),
        np.geomspace(1e-300, 1e5, 500),
        -np.geomspace(1e-12, 1e5, 500),
    ]
).tolist()


@pytest.mark.parametrize(("ours", "theirs"), [(el.sin, native.det_sin), (el.cos, native.det_cos)])
def test_sine_and_cosine_are_the_native_ones_bit_for_bit(ours, theirs):
    for x in ANGLES:
        assert ours(x) == theirs(x), x


def test_the_other_functions_are_the_native_ones_bit_for_bit():
    for x in ANGLES:
        assert el.atan2(x, 0.7) == native.det_atan2(x, 0.7), x
        assert el.atan2(0.3, x) == native.det_atan2(0.3, x), x
        if 0.0 < x < 1e5:
            assert el.log(x) == native.det_log(x), x
        if -600.0 < x < 600.0:
            assert el.exp(x) == native.det_exp(x), x


@given(st.floats(-1.0, 1.0))
def test_arc_sine_inverts_sine(x):
    assert math.isclose(el.asin(x), math.asin(x), rel_tol=1e-15, abs_tol=1e-300)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_sine_of_no_number_is_no_number(bad):
    assert math.isnan(el.sin(bad))
    assert math.isnan(el.cos(bad))


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
    assert np.allclose(el.euler_from_quaternion(*q), (roll, pitch, yaw), atol=1e-6)
