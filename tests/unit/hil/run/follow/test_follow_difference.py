"""Differences of two flights against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from hil.run.follow.difference import Motion, delay_s, differences, greatest, rms

T = np.arange(0.0, 30.0, 0.02)


def motion(shift_m: float = 0.0, turn_rad: float = 0.0, later_s: float = 0.0) -> Motion:
    t = T - later_s
    p = np.stack([np.sin(0.9 * t), 2.0 * np.cos(0.5 * t), 0.1 * t], axis=1) + np.array([shift_m, 0.0, 0.0])
    v = np.stack([0.9 * np.cos(0.9 * t), -np.sin(0.5 * t), np.full_like(t, 0.1)], axis=1)
    q = np.tile([np.cos(0.5 * turn_rad), 0.0, np.sin(0.5 * turn_rad), 0.0], (len(t), 1))
    return Motion(p, q, v, np.zeros_like(p))


def test_a_constant_offset_and_turn_are_measured_as_such() -> None:
    simulated, real = motion(0.7, 0.2), motion()
    d = differences(T, simulated, real)
    assert rms(d.position_m) == pytest.approx(0.7)
    assert d.by_axis_m.mean(axis=0) == pytest.approx([0.7, 0.0, 0.0])
    assert greatest(d.attitude_deg) == pytest.approx(np.degrees(0.2))
    assert rms(d.velocity_mps) == 0.0


def test_the_same_attitude_with_the_other_sign_is_no_difference() -> None:
    real = motion(turn_rad=0.3)
    simulated = real.__class__(real.p_WB, -real.q_WB, real.v_WB_W, real.w_WB_B)
    assert differences(T, simulated, real).attitude_deg == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("later_s", [-0.3, 0.0, 0.5])
def test_delay_is_found_to_a_step(later_s: float) -> None:
    assert delay_s(T, motion(later_s=later_s).p_WB, motion().p_WB) == pytest.approx(later_s, abs=1e-9)


def test_short_flight_has_no_delay() -> None:
    assert delay_s(T[:150], motion().p_WB[:150], motion().p_WB[:150]) is None


def test_what_was_not_measured_has_no_rms() -> None:
    assert rms(np.full(5, np.nan)) is None
    assert greatest(np.full(5, np.nan)) is None
    assert rms(np.array([3.0, np.nan, 4.0])) == pytest.approx(np.sqrt(12.5))
