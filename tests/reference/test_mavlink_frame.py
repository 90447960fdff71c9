"""Framing against the same in plain Python: frames and counters, on streams that are not all MAVLink."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge.codecs.dialect import SHAPES
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from tests.reference import mavlink_frame_reference as reference

COUNTERS = ("pending", "frames", "bad_crc", "unknown", "garbage_bytes", "lost")
MSGIDS = sorted(SHAPES)
COMMON = [0, 30, 93, 107, 113]


def v1_frame(msgid: int, payload: bytes, seq: int) -> bytes:
    body = bytes((len(payload), seq, 1, 1, msgid)) + payload
    return b"\xfe" + body + reference.mcrf4xx(body + bytes((SHAPES[msgid].crc_extra,))).to_bytes(2, "little")


@st.composite
def pieces(draw: st.DrawFn) -> bytes:
    """A frame of either version, whole, damaged or cut, or anything else."""
    kind = draw(st.sampled_from(("v2", "v2", "newer", "signed", "v1", "garbage", "header")))
    if kind == "garbage":
        return draw(st.binary(max_size=30))
    if kind == "header":
        return draw(st.sampled_from((b"\xfd", b"\xfe"))) + draw(st.binary(max_size=12))
    msgid = draw(st.sampled_from(COMMON) | st.sampled_from(MSGIDS))
    seq, length = draw(st.integers(0, 255)), SHAPES[msgid].length
    if kind == "v1":
        msgid = msgid & 0xFF if msgid & 0xFF in SHAPES else 0
        shape = SHAPES[msgid]
        sizes = st.sampled_from((shape.base_length, shape.length)) | st.integers(0, 255)
        raw = v1_frame(msgid, bytes(draw(sizes)), seq)
    else:
        if kind == "newer":
            length = draw(st.integers(length, 255))
        payload = draw(st.binary(min_size=length, max_size=length)) if length < 40 else b"\1" * length
        payload = payload[: draw(st.integers(0, length))].ljust(length, b"\0")
        encoder = reference.FrameEncoder(draw(st.integers(1, 3)), 1)
        for _ in range(seq):
            encoder.frame(0, b"\0" * 9)
        raw = encoder.frame(msgid, payload)
        if kind == "signed":
            body = raw[1:2] + b"\1" + raw[3:-2]
            raw = raw[:1] + body + reference.mcrf4xx(body + bytes((SHAPES[msgid].crc_extra,))).to_bytes(2, "little")
            raw += bytes(13)
    damage = draw(st.sampled_from(("none", "none", "none", "bit", "cut")))
    if damage == "bit":
        broken, bit = bytearray(raw), draw(st.integers(0, 8 * len(raw) - 1))
        broken[bit // 8] ^= 1 << bit % 8
        return bytes(broken)
    return raw[: draw(st.integers(0, len(raw)))] if damage == "cut" else raw


@given(st.lists(pieces(), max_size=12), st.lists(st.tuples(st.integers(0, 80), st.booleans()), max_size=20))
@settings(max_examples=400, deadline=None)
def test_frames_and_counters_are_those_of_the_reference(stream: list[bytes], chunks: list[tuple[int, bool]]) -> None:
    data, at = b"".join(stream), 0
    ours, theirs = FrameParser(), reference.FrameParser()
    for size, rescan in [*chunks, (len(data), True)]:
        chunk = data[at : at + size]
        at += size
        assert ours.feed(chunk) == theirs.feed(chunk)
        if rescan:
            assert ours.rescan() == theirs.rescan()
        assert [getattr(ours, name) for name in COUNTERS] == [getattr(theirs, name) for name in COUNTERS]


@given(st.lists(st.tuples(st.sampled_from(MSGIDS), st.binary(max_size=255)), max_size=20))
def test_encoded_frames_are_those_of_the_reference(messages: list[tuple[int, bytes]]) -> None:
    ours, theirs = FrameEncoder(7, 201), reference.FrameEncoder(7, 201)
    assert (ours.sysid, ours.compid) == (7, 201)
    for msgid, payload in messages:
        assert ours.frame(msgid, payload) == theirs.frame(msgid, payload)


def test_what_is_no_message_is_refused() -> None:
    encoder = FrameEncoder(1, 1)
    with pytest.raises(KeyError):
        encoder.frame(70000, b"")
    with pytest.raises(ValueError, match="255 bytes"):
        encoder.frame(0, bytes(256))
    with pytest.raises(TypeError):
        FrameParser().feed("text")  # type: ignore[arg-type]
    assert encoder.frame(0, bytes(9))[4] == 0  # a refused one takes no number
