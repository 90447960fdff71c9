"""MAVLink 2 signing against pymavlink's own, both ways, and the rules about time."""

from __future__ import annotations

import hashlib
import random

import pytest
from pymavlink.dialects.v20 import all as dialect

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.codecs.signing import (
    Check,
    Signer,
    SigningClock,
    SigningKey,
    Verifier,
    is_signed,
    stamp,
    strip_signature,
)

KEY = SigningKey(bytes(range(100, 132)))
MINUTE = 6_000_000
NOW = 40_000_000_000_000


class Time:
    def __init__(self, now: int = NOW) -> None:
        self.now = now

    def __call__(self) -> int:
        return self.now


def frame(raw: bytes) -> Frame:
    (found,) = FrameParser().feed(raw)
    return found


def ping(encoder: FrameEncoder, number: int = 7) -> bytes:
    message = message_class("PING")(123456789, number, 1, 1)
    return encoder.frame(message.MSGID, pack(message))


def signer(time: Time | None = None, link_id: int = 3, key: SigningKey = KEY) -> Signer:
    return Signer(key, link_id, SigningClock(time or Time()))


def verifier(time: Time | None = None) -> Verifier:
    return Verifier(KEY, SigningClock(time or Time()))


def pymavlink(timestamp: int = NOW, key: bytes = KEY.secret) -> dialect.MAVLink:
    peer = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
    peer.signing.secret_key = key
    peer.signing.sign_outgoing = True
    peer.signing.link_id = 5
    peer.signing.timestamp = timestamp
    peer.robust_parsing = True
    return peer


def test_pymavlink_accepts_what_is_signed_here() -> None:
    ours, peer, encoder = signer(), pymavlink(), FrameEncoder(9, 8)
    for number in range(300):
        raw = ours.sign(ping(encoder, number))
        (message,) = peer.parse_buffer(raw)
        assert message.get_type() == "PING", message
        assert (message.seq, message.get_srcSystem()) == (number, 9)
    assert peer.signing.timestamp >= NOW


def test_what_pymavlink_signs_is_accepted_here() -> None:
    peer, ours = pymavlink(), verifier()
    for number in range(300):
        raw = bytes(peer.ping_encode(5, number, 1, 1).pack(peer))
        assert is_signed(raw)
        assert stamp(raw) == (5, NOW + number)
        assert ours.check(frame(raw)) is Check.GOOD


def test_the_signature_is_the_beginning_of_the_hash() -> None:
    raw = signer(Time(0x010203040506)).sign(ping(FrameEncoder(1, 1)))
    assert raw[-13:-6] == bytes((3, 6, 5, 4, 3, 2, 1))
    assert raw[-6:] == hashlib.sha256(KEY.secret + raw[:-6]).digest()[:6]


def test_any_altered_byte_is_a_forgery() -> None:
    signed = signer().sign(ping(FrameEncoder(9, 8)))
    trailer = len(signed) - 13
    # Not start, length, flags and message id, most of which the parser refuses; nor the checksum, recomputed below.
    for where in (4, 5, 6, *range(10, trailer - 2), *range(trailer, len(signed))):
        raw = bytearray(signed)
        raw[where] ^= 0x10
        if where < trailer:
            # `sign` recomputes the checksum, as a forger would; its signature with another key is cut off.
            raw[:trailer] = signer(key=SigningKey(bytes(32))).sign(bytes(raw))[:-13]
        assert verifier().check(frame(bytes(raw))) is Check.FORGED, where


def test_another_key_is_a_forgery_and_leaves_no_trace() -> None:
    ours, encoder = verifier(), FrameEncoder(9, 8)
    wrong = signer(Time(NOW + 10**9), key=SigningKey(bytes(32)))
    assert ours.check(frame(wrong.sign(ping(encoder)))) is Check.FORGED
    assert ours.check(frame(signer().sign(ping(encoder)))) is Check.GOOD


def test_replays_are_detected_per_stream() -> None:
    ours, time = verifier(), Time()
    encoder, other = FrameEncoder(9, 8), FrameEncoder(9, 9)
    link3, link4 = signer(time, 3), signer(time, 4)
    first, second = link3.sign(ping(encoder)), link3.sign(ping(encoder))
    assert ours.check(frame(second)) is Check.GOOD
    assert ours.check(frame(second)) is Check.REPLAYED
    assert ours.check(frame(first)) is Check.REPLAYED
    # The same time on another link, and of another component, is another stream.
    assert ours.check(frame(link4.sign(ping(encoder)))) is Check.GOOD
    assert ours.check(frame(signer(time, 3).sign(ping(other)))) is Check.GOOD


def test_a_new_stream_may_be_a_minute_behind_and_no_more() -> None:
    encoder = FrameEncoder(9, 8)
    assert verifier().check(frame(signer(Time(NOW - MINUTE)).sign(ping(encoder)))) is Check.GOOD
    assert verifier().check(frame(signer(Time(NOW - MINUTE - 2)).sign(ping(encoder)))) is Check.REPLAYED


def test_an_accepted_timestamp_advances_the_clock() -> None:
    """An autopilot with the time of a simulated GPS may be ahead."""
    clock, encoder = SigningClock(Time()), FrameEncoder(9, 8)
    ahead = NOW + 10**12
    assert Verifier(KEY, clock).check(frame(signer(Time(ahead)).sign(ping(encoder)))) is Check.GOOD
    _, timestamp = stamp(Signer(KEY, 1, clock).sign(ping(encoder)))
    assert timestamp == ahead + 1


def test_a_timestamp_is_given_once_even_when_the_clock_stands_or_goes_back() -> None:
    time = Time()
    ours, encoder = signer(time), FrameEncoder(9, 8)
    stamps = []
    for now in (NOW, NOW, NOW, NOW - 500, NOW + 50, NOW + 50):
        time.now = now
        stamps.append(stamp(ours.sign(ping(encoder)))[1] - NOW)
    assert stamps == [0, 1, 2, 3, 50, 51]


def test_unsigned_frames_are_not_accepted_as_signed() -> None:
    encoder = FrameEncoder(9, 8)
    assert verifier().check(frame(ping(encoder))) is Check.UNSIGNED
    peer = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
    v1 = bytes(peer.ping_encode(5, 1, 1, 1).pack(peer, force_mavlink1=True))
    assert v1[0] == 0xFE
    assert verifier().check(frame(v1)) is Check.UNSIGNED
    assert signer().sign(v1) == strip_signature(v1) == v1


def test_removing_a_signature_gives_the_original_frame() -> None:
    rng, encoder, ours = random.Random(5), FrameEncoder(9, 8), signer()
    for _ in range(100):
        raw = ping(encoder, rng.randrange(2**32))
        signed = ours.sign(raw)
        assert len(signed) == len(raw) + 13
        assert strip_signature(signed) == raw
        assert ours.sign(signed)[:-13] == signed[:-13]  # signed anew, not twice


def test_keys() -> None:
    secret = bytes(range(200, 232))
    assert SigningKey.from_text(secret).secret == secret
    assert SigningKey.from_text(secret.hex().encode() + b"\n").secret == secret
    assert SigningKey.from_text(secret.hex().upper().encode()).secret == secret
    phrase = hashlib.sha256(b"a passphrase").digest()
    assert SigningKey.from_text(b"a passphrase\n").secret == phrase
    assert SigningKey.from_text(b"x" * 32).secret == hashlib.sha256(b"x" * 32).digest()
    assert SigningKey.from_text("ü".encode() * 16).secret == hashlib.sha256("ü".encode() * 16).digest()
    with pytest.raises(ValueError, match="empty"):
        SigningKey.from_text(b" \n")
    with pytest.raises(ValueError, match="32 bytes"):
        SigningKey(b"short")
    assert secret.hex() not in repr(SigningKey(secret))
    assert str(secret) not in repr(SigningKey(secret))
