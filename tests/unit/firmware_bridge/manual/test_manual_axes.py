"""Stick to message field: calibration, dead zone, expo, inversion, refusals."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.manual.axes import Axis, Calibration, StickMapping, manual_control_axes, shape
from firmware_bridge.manual.hid_gamepad import default_mapping
from firmware_bridge.manual.report_layout import AxisField, ButtonField, HidState, ReportLayout, parse_report_descriptor
from firmware_bridge.manual.sticks import ManualControlError, Sticks
from tests.worlds import hid_descriptors as hid

DEAD = st.floats(0.0, 0.9)
EXPO = st.floats(0.0, 1.0)


def test_the_fields_of_the_message():
    assert manual_control_axes(Sticks(0, 0, 0, 0)) == (0, 0, 500, 0)
    assert manual_control_axes(Sticks(1, -1, 1, -1)) == (1000, -1000, 1000, -1000)
    assert manual_control_axes(Sticks(-1, 1, -1, 1)) == (-1000, 1000, 0, 1000)
    assert manual_control_axes(Sticks(9, -9, 9, -9)) == (1000, -1000, 1000, -1000)


@given(DEAD, EXPO, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_shape_is_odd_rising_bounded_and_keeps_the_ends(dead_zone, expo, a, b):
    fa, fb = shape(a, dead_zone, expo), shape(b, dead_zone, expo)
    assert -1.0 <= fa <= 1.0
    assert fa == -shape(-a, dead_zone, expo)
    assert a > b or fa <= fb + 1e-12
    assert shape(1.0, dead_zone, expo) == pytest.approx(1.0)
    assert abs(a) > dead_zone or fa == 0.0


def test_a_dead_zone_leaves_no_jump_at_its_edge():
    assert shape(0.1001, 0.1, 0.0) == pytest.approx(0.0001 / 0.9)


def test_expo_by_hand():
    assert shape(0.5, 0.0, 0.4) == pytest.approx(0.6 * 0.5 + 0.4 * 0.125)


def test_an_axis_centres_at_the_middle_of_its_stated_range_and_inverts():
    assert Axis("x", dead_zone=0.0).value(0, 0, 255) == -1.0
    assert Axis("x", dead_zone=0.0).value(255, 0, 255) == 1.0
    assert Axis("x", dead_zone=0.05).value(128, 0, 255) == 0.0  # 8 bits have no exact centre
    assert Axis("x", dead_zone=0.05).value(127, 0, 255) == 0.0
    assert Axis("x", inverted=True, dead_zone=0.0).value(-128, -128, 127) == 1.0


def test_calibration_scales_each_side_by_itself_and_stops_at_the_ends():
    axis = Axis("x", dead_zone=0.0, calibration=Calibration(100, 1000, 1200))
    values = [axis.value(raw, 0, 2047) for raw in (0, 100, 550, 1000, 1100, 1200, 2047)]
    assert values == [-1.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.0]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Calibration(0, 0, 1),
        lambda: Calibration(5, 3, 9),
        lambda: Calibration(0, 9, 9),
        lambda: Axis("x", dead_zone=1.0),
        lambda: Axis("x", dead_zone=-0.1),
        lambda: Axis("x", dead_zone=float("nan")),
        lambda: Axis("x", expo=1.1),
        lambda: Axis("x", expo=float("nan")),
    ],
)
def test_invalid_calibrations_are_refused(make):
    with pytest.raises(ManualControlError):
        make()


def layout(*axes, buttons=1):
    fields = tuple(AxisField(name, 8 * i, 8, 0, 255) for i, name in enumerate(axes))
    return ReportLayout(None, 8, fields, tuple(ButtonField(i + 1, 56 + i) for i in range(buttons)))


def test_a_mapping_names_all_that_the_device_lacks():
    mapping = StickMapping(
        pitch=Axis("y"), roll=Axis("x"), throttle=Axis("slider"), yaw=Axis("rz"), dead_man=5, arm=1, modes={9: "hold"}
    )
    with pytest.raises(ManualControlError) as error:
        mapping.check(layout("x", "y"))
    for piece in (
        "'slider' for throttle",
        "'rz' for yaw",
        "button 5 for dead-man",
        "button 9 for mode hold",
        "axes x, y",
    ):
        assert piece in str(error.value)
    assert "button 1 " not in str(error.value)


def pushed(ids, usage, device, **raw):
    """Return the sticks by the default mapping, with the named axes moved and the others centred."""
    values = {a.name: raw.get(a.name, (a.low + a.high + 1) // 2) for a in device.axes}
    mapping = default_mapping(*ids, usage, device)
    mapping.check(device)
    return mapping.sticks(HidState(values, frozenset()), device)


def test_a_gamepad_flies_in_mode_2():
    pad, ids = layout("x", "y", "z", "rz", buttons=14), (0x054C, 0x05C4)
    assert pushed(ids, 5, pad) == (0, 0, 0, 0)
    assert pushed(ids, 5, pad, y=0) == Sticks(0, 0, 1, 0)  # left stick forward: climb
    assert pushed(ids, 5, pad, x=255) == Sticks(0, 0, 0, 1)  # left stick right: nose right
    assert pushed(ids, 5, pad, rz=0) == Sticks(1, 0, 0, 0)  # right stick forward: forward
    assert pushed(ids, 5, pad, z=255) == Sticks(0, 1, 0, 0)  # right stick right: right


def test_a_radio_flies_by_its_channels_in_the_order_aetr():
    radio, ids = parse_report_descriptor(hid.EDGETX), (0x1209, 0x4F54)
    assert pushed(ids, 4, radio, x=2047).roll == 1.0
    assert pushed(ids, 4, radio, y=2047).pitch == 1.0
    assert pushed(ids, 4, radio, z=0).throttle == -1.0
    assert pushed(ids, 4, radio, rx=2047).yaw == 1.0


def test_a_joystick_flies_with_its_slider_as_throttle():
    stick = layout("x", "y", "rz", "slider", buttons=12)
    assert pushed((1, 1), 4, stick, y=0, x=255, rz=255) == Sticks(1, 1, 0, 1)
    assert pushed((1, 1), 4, stick, slider=0).throttle == 1.0
    assert default_mapping(1, 1, 4, stick).dead_man == 1


def test_xbox_pads_of_both_firmwares_keep_their_triggers_out_of_the_flying():
    older = layout("x", "y", "rx", "ry", "z", "rz", buttons=10)
    newer = layout("x", "y", "z", "rz", buttons=15)
    assert default_mapping(0x045E, 0x02E0, 5, older).roll.source == "rx"
    assert default_mapping(0x045E, 0x02E0, 5, older).dead_man == 5
    assert default_mapping(0x045E, 0x0B13, 5, newer).roll.source == "z"
    assert default_mapping(0x045E, 0x0B13, 5, newer).dead_man == 7
    assert default_mapping(0x054C, 0x0CE6, 5, older).roll.source == "z"  # DualSense: rx, ry are the triggers
