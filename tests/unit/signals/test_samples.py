"""Every port has unit and frame; frame maps are exact."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.samples import SAMPLE_FIELDS
from tests.worlds.rotation_matrices import rotation


@pytest.mark.parametrize("sample_type", list(SAMPLE_FIELDS))
def test_every_field_has_unit_and_frame(sample_type: type) -> None:
    assert set(SAMPLE_FIELDS[sample_type]) == set(sample_type._fields)
    for field, (unit, frame) in SAMPLE_FIELDS[sample_type].items():
        assert unit, field
        assert frame, field


unit = st.floats(-1, 1, allow_nan=False)


@given(st.tuples(unit, unit, unit, unit), st.tuples(unit, unit, unit))
def test_attitude_map_agrees_with_the_vector_maps(q, v) -> None:
    norm = math.sqrt(sum(c * c for c in q))
    if norm < 1e-3:
        return
    q = tuple(c / norm for c in q)
    # A body vector taken to the world by either road ends in the same place.
    by_enu = ned_from_enu(rotation(q) @ v)
    by_ned = rotation(q_NF_from_q_WB(q)) @ frd_from_flu(v)
    assert by_ned == pytest.approx(by_enu, abs=1e-12)


def test_level_facing_north_is_identity() -> None:
    half = math.sqrt(0.5)
    q = q_NF_from_q_WB((half, 0.0, 0.0, half))  # nose along +y of ENU = north
    assert tuple(abs(c) for c in q) == pytest.approx((1, 0, 0, 0), abs=1e-15)
