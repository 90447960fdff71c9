"""MAVLink framing against pymavlink, and with bytes that are not MAVLink."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from firmware_bridge.codecs.mavlink_frame import MAX_FRAME_LENGTH, Frame, FrameEncoder, FrameParser, FrameSplitter
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.faults.hit_log import describe
from tests.worlds.faulty_transport import PIECES, frames, signed

ATTITUDE = message_class("ATTITUDE")(1000, 0.1, -0.2, 0.3, 0.01, 0.02, -0.03)
HEARTBEAT = message_class("HEARTBEAT")(2, 12, 0, 0, 0, 3)


def frame_of(message, encoder=None):
    return (encoder or FrameEncoder(1, 1)).frame(message.MSGID, pack(message))


def pymavlink_bytes(message, *, v1=False, sysid=7, compid=9, seq=0):
    mav = common.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    mav.seq = seq
    return bytes(message.pack(mav, force_mavlink1=v1))


def test_sequence_counts_up_and_wraps():
    encoder = FrameEncoder(3, 4)
    seqs = [FrameParser().feed(encoder.frame(0, pack(HEARTBEAT)))[0].seq for _ in range(300)]
    assert seqs == [i % 256 for i in range(300)]


def test_all_zero_payload_keeps_one_byte():
    raw = FrameEncoder(1, 1).frame(MSGID["PING"], bytes(14))
    assert raw[1] == 1
    assert FrameParser().feed(raw)[0].payload == bytes(14)


@pytest.mark.parametrize("v1", [False, True])
def test_reads_pymavlinks_frames(v1):
    raw = pymavlink_bytes(common.MAVLink_attitude_message(*ATTITUDE), v1=v1, seq=77)
    parser = FrameParser()
    (frame,) = parser.feed(raw)
    assert frame[:4] == (MSGID["ATTITUDE"], 7, 9, 77)
    assert frame.raw == raw
    assert unpack(frame) == pytest.approx(ATTITUDE, rel=1e-6)
    assert (parser.bad_crc, parser.garbage_bytes, parser.frames) == (0, 0, 1)


def test_mavlink1_without_extension_fields_is_extended_with_zeros():
    # HIL_SENSOR's `id` is an extension: a MAVLink 1 sender that follows the standard leaves it out.
    full = pack(message_class("HIL_SENSOR")(5, *[1.0] * 13, 0x1FFF, 3))
    payload = full[:-1]
    header = struct.pack("<BBBBB", len(payload), 0, 1, 1, MSGID["HIL_SENSOR"])
    crc = common.x25crc(header + payload + bytes([common.MAVLink_hil_sensor_message.crc_extra])).crc
    (frame,) = FrameParser().feed(b"\xfe" + header + payload + struct.pack("<H", crc))
    assert unpack(frame).id == 0
    assert unpack(frame).fields_updated == 0x1FFF


def test_unknown_incompatibility_flags_are_refused():
    raw = bytearray(frame_of(ATTITUDE))
    raw[2] = 0x02
    assert FrameParser().feed(bytes(raw)) == []


@given(st.lists(st.integers(1, 40), max_size=30), st.randoms(use_true_random=False))
def test_frames_do_not_depend_on_chunks(sizes, rng):
    encoder = FrameEncoder(1, 1)
    stream = b""
    for _ in range(8):
        stream += rng.randbytes(rng.randrange(20)) + frame_of(rng.choice([ATTITUDE, HEARTBEAT]), encoder)
    whole = FrameParser()
    expected = whole.feed(stream)
    parts = FrameParser()
    got: list[Frame] = []
    at = 0
    for size in sizes:
        got += parts.feed(stream[at : at + size])
        at += size
    got += parts.feed(stream[at:])
    assert got == expected
    assert (parts.bad_crc, parts.garbage_bytes, parts.pending) == (whole.bad_crc, whole.garbage_bytes, whole.pending)


@given(st.binary(max_size=600))
def test_garbage_before_a_frame_never_hides_it_for_long(garbage):
    parser = FrameParser()
    raw = frame_of(ATTITUDE)
    frames = parser.feed(garbage + raw)
    # A header inside the garbage may claim up to one frame's length of what follows: then it must come to light
    # once that much has arrived, or when the line is quiet.
    frames += parser.rescan()
    frames += parser.feed(bytes(MAX_FRAME_LENGTH))
    assert raw in [f.raw for f in frames]
    assert parser.pending < MAX_FRAME_LENGTH


@given(st.data())
@settings(max_examples=200)
def test_one_flipped_bit_costs_one_frame(data):
    encoder = FrameEncoder(1, 1)
    raws = [frame_of(ATTITUDE, encoder) for _ in range(12)]
    victim = data.draw(st.integers(0, 3))
    broken = bytearray(raws[victim])
    bit = data.draw(st.integers(0, 8 * len(broken) - 1))
    broken[bit // 8] ^= 1 << bit % 8
    stream = b"".join(bytes(broken) if i == victim else raw for i, raw in enumerate(raws))
    got = [f.raw for f in FrameParser().feed(stream)]
    assert [raw for i, raw in enumerate(raws) if i != victim] == got


def test_rescan_looks_behind_several_false_headers():
    false = b"\xfd\xff\x00\x00\x07\x01\x01\x1e\x00\x00"
    good = frame_of(ATTITUDE)
    parser = FrameParser()
    assert parser.feed(false + b"xx" + false + good) == []
    assert [f.raw for f in parser.rescan()] == [good]
    assert parser.garbage_bytes == 2 * len(false) + 2


def test_rescan_leaves_a_slow_frame_alone():
    raw = frame_of(ATTITUDE)
    parser = FrameParser()
    assert parser.feed(raw[:20]) == []
    assert parser.rescan() == []
    assert parser.garbage_bytes == 0
    assert [f.raw for f in parser.feed(raw[20:])] == [raw]


def test_lost_frames_are_counted_per_sender():
    a, b = FrameEncoder(1, 1), FrameEncoder(1, 2)
    stream = [frame_of(HEARTBEAT, a) for _ in range(5)]
    other = [frame_of(HEARTBEAT, b) for _ in range(5)]
    parser = FrameParser()
    parser.feed(stream[0] + other[0] + stream[3] + other[1] + stream[4] + other[4])
    assert parser.lost == 2 + 2


def test_all_bytes_outside_frames_are_counted():
    parser = FrameParser()
    raw = frame_of(ATTITUDE)
    parser.feed(b"noise" + raw + b"\x00" * 7 + raw)
    assert parser.garbage_bytes == 12
    assert parser.frames == 2


def test_unknown_messages_are_skipped_and_counted():
    raw = bytearray(frame_of(ATTITUDE))
    raw[7:10] = (70000).to_bytes(3, "little")
    parser = FrameParser()
    good = frame_of(HEARTBEAT)
    assert [f.raw for f in parser.feed(bytes(raw) + good)] == [good]
    assert parser.unknown == 1


def test_start_bytes_alone_take_linear_time_and_bounded_memory():
    parser = FrameParser()
    for byte in (b"\xfd", b"\xfe"):
        assert parser.feed(byte * 200_000) == []
    assert parser.pending < MAX_FRAME_LENGTH


def test_invalid_messages_are_refused():
    encoder = FrameEncoder(1, 1)
    with pytest.raises(KeyError):
        encoder.frame(70000, b"")
    with pytest.raises(ValueError, match="255 bytes"):
        encoder.frame(0, bytes(256))
    with pytest.raises(TypeError):
        FrameParser().feed("text")  # type: ignore[arg-type]
    assert encoder.frame(0, bytes(9))[4] == 0  # a refused message uses no sequence number


def test_ids_of_a_sender_are_checked():
    with pytest.raises(ValueError, match="sysid and compid"):
        FrameEncoder(0, 1)


@settings(max_examples=200)
@given(pieces=PIECES)
def test_joined_units_equal_the_stream(pieces: list[bytes]) -> None:
    splitter = FrameSplitter()
    units = []
    for piece in pieces:
        units += splitter.feed(piece)
        assert splitter.pending < 280
    units += splitter.flush()
    assert b"".join(units) == b"".join(pieces)
    whole = FrameSplitter()
    assert whole.feed(b"".join(pieces)) + whole.flush() == units


def test_units_are_frames_of_both_versions_signed_or_not_and_of_other_dialects() -> None:
    v2 = frames(1)[0]
    v1 = b"\xfe\x09\x00\x01\x01\x00" + bytes(9)
    v1 += common.x25crc(v1[1:] + b"\x32").crc.to_bytes(2, "little")  # HEARTBEAT's crc_extra is 50
    foreign = b"\xfd\x03\x00\x00\x05\x01\x01\x11\x00\x01abc!!"
    damaged = v2[:15] + b"\x00" + v2[16:]
    units = FrameSplitter().feed(b"x" + v2 + signed(v2) + v1 + foreign + damaged + v2)
    assert units[:5] == [b"x", v2, signed(v2), v1, foreign]
    assert units[-1] == v2
    assert all(len(unit) == 1 for unit in units[5:-1])
    assert [describe(unit) for unit in units[:5]] == ["byte 0x78", "ATTITUDE", "ATTITUDE", "HEARTBEAT", "message 65553"]
