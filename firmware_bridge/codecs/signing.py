"""MAVLink 2 signing (https://mavlink.io/en/guide/message_signing.html): makes, verifies and removes signatures.

A signed frame has incompatibility flag 1 and 13 bytes after its checksum:

    link id, 1 byte | timestamp, 6 bytes, little-endian, 10 us since 2015-01-01T00:00Z | signature, 6 bytes

The signature is the first bytes of SHA-256(key, frame up to and including the timestamp). A timestamp must be greater
than the last one of the same stream (link id, system, component); the first one of a stream may be at most a minute
behind the receiver's clock. The receiver moves its clock up to the timestamp of each accepted frame.

A timestamp is never used twice, also not in another run: autopilots keep the last one over their restarts and refuse
older ones. So it comes from the wall clock, not from simulated time, and a run in which the bench signs is not
repeatable.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import struct
import time
from collections.abc import Callable
from enum import Enum

from firmware_bridge.codecs.dialect import MSGID
from firmware_bridge.codecs.mavlink_frame import Frame, with_checksum
from signals.time import NS_PER_S

KEY_LENGTH = 32
SETUP_SIGNING = MSGID["SETUP_SIGNING"]  # carries a key: must not be forwarded or logged
# Made by radios, which have no key: the standard's only exception.
ACCEPTED_UNSIGNED = frozenset({MSGID["RADIO_STATUS"]})

_EPOCH_2015_NS = 1_420_070_400 * NS_PER_S
_MINUTE = 60 * 100_000  # in units of 10 us
_V2, _FLAG = 0xFD, 0x01
_TRAILER, _SIGNATURE = 13, 6
_STAMP = struct.Struct("<BQ")
_HEX_KEY = re.compile(rb"[0-9a-fA-F]{64}")


class SigningKey:
    """32 secret bytes. `repr` hides them, so that no message or traceback contains them."""

    __slots__ = ("secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_LENGTH:
            raise ValueError(f"a signing key has {KEY_LENGTH} bytes, not {len(secret)}")
        self.secret = secret

    @classmethod
    def from_text(cls, data: bytes) -> SigningKey:
        """Read the key from a file's content: 64 hexadecimal digits, else 32 raw bytes, else a passphrase.

        The key of a passphrase is its SHA-256, as in QGroundControl and Mission Planner, without white space at its
        ends. ValueError if the content is empty.
        """
        text = data.strip()
        if _HEX_KEY.fullmatch(text):
            return cls(bytes.fromhex(text.decode()))
        if len(data) == KEY_LENGTH and not _is_text(text):
            return cls(data)
        if not text:
            raise ValueError("it is empty")
        return cls(hashlib.sha256(text).digest())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SigningKey) and hmac.compare_digest(self.secret, other.secret)

    def __hash__(self) -> int:
        return hash(self.secret)

    def __repr__(self) -> str:
        return "SigningKey(...)"


class Check(Enum):
    """The verdict of a verifier on a frame."""

    GOOD = "good"
    UNSIGNED = "unsigned"
    FORGED = "forged"  # signed with another key, or altered since
    REPLAYED = "replayed"  # its timestamp is not newer than the stream's last, or over a minute old


def _is_text(data: bytes) -> bool:
    try:
        return data.decode().isprintable()
    except UnicodeDecodeError:
        return False


def wall_timestamp() -> int:
    """Return the machine's time in 10 us since 2015."""
    return (time.time_ns() - _EPOCH_2015_NS) // 10_000


class SigningClock:
    """One side's signing time: the machine's clock, but never behind a sent or accepted timestamp."""

    def __init__(self, now: Callable[[], int] = wall_timestamp) -> None:
        self._now = now
        self._last = 0

    def current(self) -> int:
        return max(self._last, self._now())

    def take(self) -> int:
        """Return a new timestamp to sign with."""
        self._last = max(self._last + 1, self._now())
        return self._last

    def move_up(self, timestamp: int) -> None:
        self._last = max(self._last, timestamp)


class Signer:
    """Signs frames, under one link id."""

    def __init__(self, key: SigningKey, link_id: int, clock: SigningClock | None = None) -> None:
        self._key = key
        self._link_id = link_id
        self._clock = clock if clock is not None else SigningClock()

    def sign(self, raw: bytes) -> bytes:
        """Return the frame with a new signature. A MAVLink 1 frame cannot have one and is returned unchanged."""
        if raw[0] != _V2:
            return raw
        data = _with_flag(strip_signature(raw), _FLAG) + _STAMP.pack(self._link_id, self._clock.take())[:7]
        return data + _signature(self._key, data)


class Verifier:
    """Verifies frames and keeps each stream's last timestamp."""

    def __init__(self, key: SigningKey, clock: SigningClock | None = None) -> None:
        self._key = key
        self._clock = clock if clock is not None else SigningClock()
        self._streams: dict[tuple[int, int, int], int] = {}

    def check(self, frame: Frame) -> Check:
        """Verify a frame. Only a GOOD one moves the clocks, of its stream and of the verifier."""
        if not is_signed(frame.raw):
            return Check.UNSIGNED
        if not matches(self._key, frame.raw):
            return Check.FORGED
        link_id, timestamp = stamp(frame.raw)
        stream = (link_id, frame.sysid, frame.compid)
        last = self._streams.get(stream)
        if timestamp <= last if last is not None else timestamp + _MINUTE < self._clock.current():
            return Check.REPLAYED
        self._streams[stream] = timestamp
        self._clock.move_up(timestamp)
        return Check.GOOD


def is_signed(raw: bytes) -> bool:
    return raw[0] == _V2 and bool(raw[2] & _FLAG)


def stamp(raw: bytes) -> tuple[int, int]:
    """Return (link id, timestamp [10 us since 2015]) of a signed frame."""
    return raw[-_TRAILER], int.from_bytes(raw[-_TRAILER + 1 : -_SIGNATURE], "little")


def matches(key: SigningKey, raw: bytes) -> bool:
    """Return True if a frame is signed with `key`, whatever its timestamp."""
    return hmac.compare_digest(_signature(key, raw[:-_SIGNATURE]), raw[-_SIGNATURE:])


def strip_signature(raw: bytes) -> bytes:
    """Return the frame without its signature, with a new checksum."""
    return _with_flag(raw[:-_TRAILER], 0) if is_signed(raw) else raw


def _with_flag(raw: bytes, flag: int) -> bytes:
    """Return a frame without trailer, with the given signed flag and a new checksum."""
    msgid = raw[7] | raw[8] << 8 | raw[9] << 16
    body = raw[:2] + bytes((raw[2] & ~_FLAG | flag,)) + raw[3 : 10 + raw[1]]
    return with_checksum(body, msgid)


def _signature(key: SigningKey, data: bytes) -> bytes:
    return hashlib.sha256(key.secret + data).digest()[:_SIGNATURE]
