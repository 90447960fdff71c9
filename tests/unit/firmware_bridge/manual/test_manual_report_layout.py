"""HID report descriptors: decoded correctly, or refused if invalid."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.manual.report_layout import parse_report_descriptor
from firmware_bridge.manual.sticks import ManualControlError
from tests.worlds import hid_descriptors as hid


def test_axes_hat_and_buttons_of_a_plain_gamepad():
    layout = parse_report_descriptor(hid.SIMPLE)
    assert [a.name for a in layout.axes] == ["x", "y", "z", "rz", "hat"]
    assert (layout.report_id, layout.size_bytes, len(layout.buttons)) == (None, 7, 12)
    state = layout.read(hid.simple_report(1, 2, 3, 255, 1, 12))
    assert state.axes == {"x": 1, "y": 2, "z": 3, "rz": 255, "hat": 8}
    assert state.pressed == {1, 12}


def test_the_edgetx_report():
    """24 buttons, then eight 16-bit channels of 0..2047."""
    layout = parse_report_descriptor(hid.EDGETX)
    assert (layout.report_id, layout.size_bytes) == (None, 19)
    assert [a.name for a in layout.axes] == ["x", "y", "z", "rx", "ry", "rz", "slider", "slider2"]
    assert [(a.first_bit, a.bits, a.low, a.high) for a in layout.axes] == [(24 + 16 * i, 16, 0, 2047) for i in range(8)]
    assert [(b.button, b.bit) for b in layout.buttons] == [(i + 1, i) for i in range(24)]


def test_signed_axes_of_ten_bits_across_bytes():
    layout = parse_report_descriptor(hid.gamepad(hid.axes(0x30, 0x31, low=-512, high=511, bits=10), hid.padding(4)))
    number = (-512 & 0x3FF) | (511 << 10)
    assert layout.read(number.to_bytes(3, "little")).axes == {"x": -512, "y": 511}


def test_numbered_reports_the_one_with_the_sticks_is_taken():
    other = hid.items((hid.ID, 2)) + hid.buttons(8)
    sticks = hid.items((hid.ID, 7)) + hid.axes(0x30, 0x31, low=0, high=255, bits=8)
    layout = parse_report_descriptor(hid.gamepad(other, sticks))
    assert (layout.report_id, layout.size_bytes) == (7, 2)
    assert layout.read(b"\x07\x01\x02").axes == {"x": 1, "y": 2}
    assert layout.read(b"\x02\x01") is None
    assert layout.is_other_report(b"\x02\x01")
    assert not layout.is_other_report(b"\x07\x01")
    assert layout.read(b"") is None


def test_pushed_state_extended_usages_and_repeated_names():
    parts = (
        hid.items((hid.PAGE, 1), (hid.LOW, 0), (hid.HIGH, 255), (hid.SIZE, 8), (hid.COUNT, 1), (hid.PUSH, 0)),
        hid.items((hid.SIZE, 2), (hid.PAGE, 9), (hid.POP, 0)),
        hid.items((hid.USAGE, 0x30), (hid.INPUT, 2), (hid.USAGE, 0x36), (hid.INPUT, 2)),
        hid.item(hid.USAGE, 0x00010036, 4),
        hid.item(hid.USAGE, 0x000200BB, 4),
        hid.items((hid.COUNT, 2), (hid.INPUT, 2)),
    )
    layout = parse_report_descriptor(hid.gamepad(*parts))
    assert [a.name for a in layout.axes] == ["x", "slider", "slider2", "throttle"]
    assert all(a.bits == 8 for a in layout.axes)


def test_relative_axes_constants_and_arrays_are_skipped_with_their_bits():
    mouse = hid.items((hid.PAGE, 1), (hid.USAGE, 0x30), (hid.SIZE, 8), (hid.COUNT, 1), (hid.INPUT, 6))
    array = hid.items((hid.PAGE, 9), (hid.FIRST, 1), (hid.LAST, 9), (hid.SIZE, 8), (hid.COUNT, 2), (hid.INPUT, 0))
    sticks = hid.axes(0x30, 0x31, low=0, high=255, bits=8)
    layout = parse_report_descriptor(hid.gamepad(mouse, array, sticks))
    assert [(a.name, a.first_bit) for a in layout.axes] == [("x", 24), ("y", 32)]
    assert layout.size_bytes == 5


def test_output_items_have_no_bits_and_their_usages_are_dropped():
    rumble = hid.items((hid.PAGE, 1), (hid.USAGE, 0x33), (hid.SIZE, 8), (hid.COUNT, 4), (hid.OUTPUT, 2))
    layout = parse_report_descriptor(hid.gamepad(rumble, hid.axes(0x30, 0x31, low=0, high=255, bits=8)))
    assert [(a.name, a.first_bit) for a in layout.axes] == [("x", 0), ("y", 8)]


@pytest.mark.parametrize("report", [b"", b"\x80" * 6, hid.simple_report()[:-1], hid.simple_report() + b"\x01"])
def test_reports_of_another_length_are_ignored(report):
    assert parse_report_descriptor(hid.SIMPLE).read(report) is None


def test_trailing_zeros_as_from_windows_are_accepted():
    assert parse_report_descriptor(hid.SIMPLE).read(hid.simple_report(7) + bytes(20)).axes["x"] == 7


def test_a_stick_out_of_its_range_invalidates_the_report():
    layout = parse_report_descriptor(hid.gamepad(hid.axes(0x30, 0x31, low=0, high=2047, bits=16)))
    assert layout.read((2047).to_bytes(2, "little") * 2) is not None
    assert layout.read((2048).to_bytes(2, "little") * 2) is None


@pytest.mark.parametrize(
    ("descriptor", "word"),
    [
        (b"", "fewer than two axes"),
        (hid.gamepad(hid.buttons(12)), "fewer than two axes"),
        (hid.gamepad(hid.axes(0x30, 0x39, low=0, high=7, bits=8)), "fewer than two axes"),
        (hid.SIMPLE + b"\x26\xff", "ends inside"),
        (b"\xb4", "never pushed"),
        (bytes(5000), "5000 bytes"),
        (hid.gamepad(hid.axes(0x30, 0x31, low=0, high=1, bits=8), hid.items((hid.SIZE, 200))), None),
        (hid.items((hid.SIZE, 64), (hid.COUNT, 65535), (hid.INPUT, 2)), "bits"),
        (hid.axes(0x30, 0x31, low=0, high=9, bits=8) + hid.items((hid.ID, 1)) + hid.buttons(8), "numbered"),
    ],
)
def test_invalid_descriptors_are_refused_with_a_reason(descriptor, word):
    if word is None:
        parse_report_descriptor(descriptor)
        return
    with pytest.raises(ManualControlError, match=word):
        parse_report_descriptor(descriptor)


@given(st.binary(max_size=200), st.binary(max_size=40))
def test_any_bytes_end_in_a_layout_or_a_named_error(descriptor, report):
    try:
        layout = parse_report_descriptor(descriptor)
    except ManualControlError:
        return
    layout.read(report)


@given(st.data())
def test_damaged_descriptors_end_in_a_layout_or_a_named_error(data):
    damaged = bytearray(hid.SIMPLE)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    try:
        layout = parse_report_descriptor(bytes(damaged))
    except ManualControlError:
        return
    state = layout.read(bytes(layout.size_bytes))
    assert state is None or all(a.low <= state.axes[a.name] <= a.high for a in layout.axes if a.name != "hat")
