"""Control allocation of the mock autopilot: exact within the limits, by priority at them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge import _native
from tests.reference.ekf_reference import parameters

X500 = {"x": (0.174, -0.174, 0.174, -0.174), "y": (0.174, -0.174, -0.174, 0.174), "km": (0.016, 0.016, -0.016, -0.016)}
IRIS = {
    "x": (0.1515, -0.1515, 0.1515, -0.1515),
    "y": (0.245, -0.1875, -0.245, 0.1875),
    "km": (0.06, 0.06, -0.06, -0.06),
}
HEXA = {
    "x": (0.0, 0.0, 0.22, -0.22, 0.22, -0.22),
    "y": (0.25, -0.25, -0.125, 0.125, 0.125, -0.125),
    "km": (-0.05, 0.05, -0.05, 0.05, 0.05, -0.05),
}
FRAMES = {"x500": X500, "iris": IRIS, "hexa": HEXA}


def frame_parameters(frame: dict[str, tuple[float, ...]], **changes: float) -> np.ndarray:
    values = {"CA_ROTOR_COUNT": float(len(frame["x"])), "MOT_SPIN_IDLE": 0.0, **changes}
    for i, (x, y, km) in enumerate(zip(frame["x"], frame["y"], frame["km"], strict=True)):
        values |= {f"CA_ROTOR{i}_PX": x, f"CA_ROTOR{i}_PY": y, f"CA_ROTOR{i}_KM": km}
    return parameters(**values)


def effectiveness(frame: dict[str, tuple[float, ...]]) -> np.ndarray:
    """Return rows roll, pitch, yaw, thrust in FRD from rotor thrusts: r x (0, 0, -T) and the drag moment."""
    rows = []
    for x, y, km in zip(frame["x"], frame["y"], frame["km"], strict=True):
        torque = np.cross((x, y, 0.0), (0.0, 0.0, -1.0)) + np.array([0.0, 0.0, km])
        rows.append([*torque, 1.0])
    return np.array(rows).T


@pytest.mark.parametrize("name", FRAMES)
def test_unsaturated_allocation_gives_exactly_the_demand(name):
    frame = FRAMES[name]
    b = effectiveness(frame)
    params = frame_parameters(frame)

    def wrench(roll: float, pitch: float, yaw: float, thrust: float) -> np.ndarray:
        u, tilt, turn = _native.allocate(params, roll, pitch, yaw, thrust)
        assert (tilt, turn) == (1.0, 1.0)
        return b @ np.square(u)

    base = wrench(0.0, 0.0, 0.0, 0.5)
    assert base == pytest.approx([0.0, 0.0, 0.0, 0.5 * len(frame["x"])], abs=1e-14)
    for axis in range(3):
        demand = [0.0, 0.0, 0.0]
        demand[axis] = 0.05
        change = wrench(*demand, 0.5) - base
        others = [i for i in range(4) if i != axis]
        assert change[axis] > 0.0
        assert change[others] == pytest.approx(0.0, abs=1e-14)
        demand[axis] = -0.1
        assert wrench(*demand, 0.5) - base == pytest.approx(-2.0 * change, abs=1e-13)
    # Least effort: the allocation lies in the row space of B, so it is the pseudo-inverse's.
    thrusts = np.square(_native.allocate(params, 0.04, -0.03, 0.02, 0.5)[0])
    assert thrusts == pytest.approx(np.linalg.pinv(b) @ (b @ thrusts), abs=1e-13)


def test_entries_are_scaled_as_px4_scales_them():
    params = frame_parameters(X500)
    level = np.square(_native.allocate(params, 0.0, 0.0, 0.0, 0.5)[0])
    roll = np.square(_native.allocate(params, 0.1, 0.0, 0.0, 0.5)[0]) - level
    yaw = np.square(_native.allocate(params, 0.0, 0.0, 0.1, 0.5)[0]) - level
    assert roll == pytest.approx(0.1 * np.sqrt(0.5) * np.array([-1, 1, 1, -1]), abs=1e-14)
    assert yaw == pytest.approx(0.1 * np.array([1, 1, -1, -1]), abs=1e-14)


@given(
    roll=st.floats(-1, 1),
    pitch=st.floats(-1, 1),
    yaw=st.floats(-1, 1),
    thrust=st.floats(0, 1),
    name=st.sampled_from(sorted(FRAMES)),
)
@settings(max_examples=300)
def test_saturation_keeps_limits_and_priorities(roll, pitch, yaw, thrust, name):
    frame = FRAMES[name]
    params = frame_parameters(frame, MOT_SPIN_IDLE=0.1)
    u, tilt_share, yaw_share = _native.allocate(params, roll, pitch, yaw, thrust)
    thrusts = np.square(u)
    assert np.all(thrusts <= 1.0 + 1e-12)
    assert np.all(thrusts >= 0.01 - 1e-12)
    assert 0.0 <= tilt_share <= 1.0 + 1e-12
    assert 0.0 <= yaw_share <= 1.0 + 1e-12
    # Yaw never costs roll or pitch; nothing ever raises the collective (airmode off).
    assert _native.allocate(params, roll, pitch, 0.0, thrust)[1] == tilt_share
    assert np.sum(thrusts) <= len(u) * max(thrust, 0.01) + 1e-9
    # The allocated torque keeps its direction. Below idle thrust none can be allocated.
    if thrust > 0.05:
        b = effectiveness(frame)
        given_tilt = (b @ thrusts)[:2]
        small = np.square(_native.allocate(params, 1e-3 * roll, 1e-3 * pitch, 0.0, 0.5)[0])
        unit = (b @ small)[:2] * 1e3
        assert given_tilt == pytest.approx(tilt_share * unit, abs=1e-9)


def test_full_thrust_gives_way_to_roll_but_not_to_yaw():
    params = frame_parameters(X500)
    b = effectiveness(X500)
    u, tilt, _ = _native.allocate(params, 0.3, 0.0, 0.0, 1.0)
    assert tilt == 1.0
    assert (b @ np.square(u))[3] < 4.0 - 4 * 0.2
    u, tilt, turn = _native.allocate(params, 0.0, 0.0, 0.5, 1.0)
    assert (tilt, turn) == (1.0, 0.0)
    assert np.sum(np.square(u)) == pytest.approx(4.0)


@pytest.mark.parametrize("factor", [0.0, 0.3, 1.0])
def test_thrust_curve_is_inverted(factor):
    params = frame_parameters(X500, THR_MDL_FAC=factor)
    for thrust in (0.0, 0.1, 0.6, 1.0):
        u = _native.allocate(params, 0.0, 0.0, 0.0, thrust)[0][0]
        assert factor * u * u + (1.0 - factor) * u == pytest.approx(thrust, abs=1e-15)


def test_geometry_without_authority_is_refused():
    with pytest.raises(ValueError, match="CA_ROTORi"):
        _native.FlightCore(frame_parameters({**X500, "km": (0.0, 0.0, 0.0, 0.0)}))
    core = _native.FlightCore(parameters())
    index = _native.PARAM_NAMES.index("CA_ROTOR_COUNT")
    with pytest.raises(ValueError, match="cannot produce roll"):
        core.set_param(index, 3.0)  # three rotors cannot control roll, pitch, yaw and thrust independently
    assert core.get_param(index) == 4.0


def test_a_rotor_that_points_ahead_is_left_out():
    pusher = {"CA_ROTOR4_PX": -0.2, "CA_ROTOR4_PZ": 0.1, "CA_ROTOR4_AX": 1.0, "CA_ROTOR4_AZ": 0.0, "CA_ROTOR4_KM": 0.05}
    alone = frame_parameters(X500)
    beside = frame_parameters(X500, **pusher)
    beside[list(_native.PARAM_NAMES).index("CA_ROTOR_COUNT")] = 5.0
    for demand in ((0.1, -0.05, 0.1, 0.5), (0.6, 0.6, 0.5, 0.9), (0.0, 0.4, 0.0, 0.05)):
        expected, found = _native.allocate(alone, *demand), _native.allocate(beside, *demand)
        assert found[1:] == expected[1:]
        assert list(found[0][:4]) == list(expected[0][:4])
        assert found[0][4] == 0.0
