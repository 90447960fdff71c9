"""Every message of the dialect, both ways, against pymavlink."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from firmware_bridge.codecs.dialect import FRAMING_ONLY, SHAPES
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, NAME, _codec, message_class, pack, unpack

INTEGER_RANGE = {k: struct.calcsize(k) * 8 for k in "bBhHiIqQ"}


def f32(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def scalar(kind: str) -> st.SearchStrategy:
    if kind == "f":
        return st.floats(width=32, allow_nan=False)
    if kind == "d":
        return st.floats(allow_nan=False)
    bits = INTEGER_RANGE[kind]
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind.islower() else st.integers(0, 2**bits - 1)


def field(count: int, kind: str) -> st.SearchStrategy:
    if kind == "s":
        return st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=count)
    if count:
        return st.lists(scalar(kind), min_size=count, max_size=count).map(tuple)
    return scalar(kind)


def message(draw, name: str):
    codec = _codec(MSGID[name])
    return codec.cls(*(draw(field(count, kind)) for _, _, count, kind in codec.fields))


def theirs(name: str, values):
    """Return pymavlink's message with the same values."""
    as_theirs = [v.encode() if isinstance(v, str) else list(v) if isinstance(v, tuple) else v for v in values]
    return dialect.mavlink_map[MSGID[name]](*as_theirs)


@settings(max_examples=3)
@given(data=st.data())
def check_both_ways(name, data):
    ours = message(data.draw, name)
    raw = FrameEncoder(7, 9).frame(ours.MSGID, pack(ours))
    mav = dialect.MAVLink(None, srcSystem=7, srcComponent=9)
    assert raw == bytes(theirs(name, ours).pack(mav))

    (frame,) = FrameParser().feed(raw)
    assert unpack(frame) == ours
    decoded = dialect.MAVLink(None).decode(bytearray(raw))
    for key, value in zip(ours._fields, ours, strict=True):
        got = getattr(decoded, key)
        if isinstance(value, str):
            assert (got.decode() if isinstance(got, bytes) else got) == value
        else:
            assert (tuple(got) if isinstance(got, list) else got) == value


def test_every_message_both_ways_against_pymavlink():
    for name in sorted(MSGID):
        check_both_ways(name=name)


def test_lengths_agree_with_the_dialect():
    for msgid, shape in SHAPES.items():
        if msgid not in dialect.mavlink_map:
            assert msgid in FRAMING_ONLY
            continue
        m = dialect.mavlink_map[msgid]
        assert (shape.crc_extra, shape.length) == (m.crc_extra, m.unpacker.size), NAME[msgid]
        assert 0 < shape.base_length <= shape.length <= 255
    # From the XML: HIL_SENSOR's id, STATUSTEXT's id and chunk_seq, COMMAND_ACK's last four.
    assert SHAPES[MSGID["HIL_SENSOR"]].base_length == 64
    assert SHAPES[MSGID["STATUSTEXT"]].base_length == 51
    assert SHAPES[MSGID["COMMAND_ACK"]].base_length == 3


def test_extension_fields_may_be_left_out():
    assert message_class("COMMAND_ACK")(400, 0) == (400, 0, 0, 0, 0, 0)
    assert message_class("STATUSTEXT")(6, "hello").chunk_seq == 0
    with pytest.raises(TypeError):
        message_class("COMMAND_ACK")(400)


def test_unknown_messages_are_refused():
    with pytest.raises(CodecError, match="NO_SUCH"):
        message_class("NO_SUCH")
    with pytest.raises(CodecError, match="70000"):
        unpack(Frame(70000, 1, 1, 0, b"", b""))


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (lambda: message_class("HEARTBEAT")(2, 12, 300, 0, 0, 3), "HEARTBEAT.base_mode"),
        (lambda: message_class("HEARTBEAT")(2, 12, "x", 0, 0, 3), "HEARTBEAT.base_mode"),
        (lambda: message_class("HEARTBEAT")(2, 12, 1.5, 0, 0, 3), "HEARTBEAT.base_mode"),
        (lambda: message_class("ATTITUDE")(1, 1e39, 0, 0, 0, 0, 0), "ATTITUDE.roll"),
        (lambda: message_class("STATUSTEXT")(6, "x" * 51), "STATUSTEXT.text"),
        (lambda: message_class("HIL_ACTUATOR_CONTROLS")(1, (0.0,) * 15, 0, 0), "HIL_ACTUATOR_CONTROLS.controls"),
    ],
)
def test_a_value_that_does_not_fit_names_its_field(make, names):
    with pytest.raises(CodecError, match=names):
        pack(make())


def test_text_ends_at_its_first_nul_and_survives_bytes_that_are_no_utf8():
    payload = bytes([6]) + b"ok\0rest".ljust(50, b"\xff") + bytes(3)
    assert unpack(Frame(MSGID["STATUSTEXT"], 1, 1, 0, payload, b"")).text == "ok"
    payload = bytes([6]) + b"\xff\xfe".ljust(50, b"\0") + bytes(3)
    assert unpack(Frame(MSGID["STATUSTEXT"], 1, 1, 0, payload, b"")).text == "��"


def test_nan_is_transmitted():
    m = message_class("MISSION_ITEM_INT")(1, 1, 0, 6, 16, 0, 1, 0.0, 0.0, 0.0, math.nan, 1, 2, 3.0, 0)
    (frame,) = FrameParser().feed(FrameEncoder(1, 1).frame(m.MSGID, pack(m)))
    assert math.isnan(unpack(frame).param4)


def test_newer_senders_may_add_fields_behind_ours():
    frame = Frame(0, 1, 1, 0, pack(message_class("HEARTBEAT")(2, 12, 0, 0, 0, 3)) + b"more", b"")
    assert unpack(frame).autopilot == 12


def test_a_short_payload_is_an_error_with_a_name():
    with pytest.raises(CodecError, match="HEARTBEAT"):
        unpack(Frame(0, 1, 1, 0, b"abc", b""))
