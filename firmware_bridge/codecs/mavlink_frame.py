"""MAVLink frames: bytes in, checked frames out, and back.

MAVLink 2 (0xFD, https://mavlink.io/en/guide/serialization.html):
    FD len incompat compat seq sysid compid msgid[3] payload[len] crc[2] (signature[13] if incompat & 1)
MAVLink 1 (0xFE):
    FE len seq sysid compid msgid payload[len] crc[2]
crc is CRC-16/MCRF4XX over everything after the start byte up to the payload's end, then over the message's
crc_extra. MAVLink 2 senders cut zero bytes off the payload's end; receivers put them back.
"""

from __future__ import annotations

from typing import NamedTuple

from firmware_bridge import _native
from firmware_bridge.codecs.dialect import SHAPES

MAX_FRAME_LENGTH = _native.MAX_FRAME_LENGTH


class Frame(NamedTuple):
    """One checked frame.

    `payload` has the message's full length, cut zeros put back; `raw` is what was on the wire.
    """

    msgid: int
    sysid: int
    compid: int
    seq: int
    payload: bytes
    raw: bytes


_DIALECT = _native.Dialect(SHAPES, Frame)


class FrameParser(_native.FrameParser):
    """Incremental parser of one byte stream.

    Never raises, whatever the bytes. Frames come out in stream order and depend on the stream only, not on
    how it was cut into chunks. At most `MAX_FRAME_LENGTH` - 1 bytes are held back. Time is linear in the
    bytes fed.

    After bytes that are no frame it looks for the next start byte right behind the one that deceived it, so
    that a true frame inside a false one is not lost. Counters: `frames` good ones; `bad_crc` headers that
    made sense but whose checksum failed; `unknown` headers with a message id outside the dialect;
    `garbage_bytes` all bytes that belong to no good frame; `lost` gaps in the sequence numbers, per (sysid,
    compid); `senders` those pairs.
    """

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__(_DIALECT)


class FrameEncoder(_native.FrameEncoder):
    """Makes the frames of one sender and owns its sequence number.

    MAVLink 2, unsigned, trailing zeros cut.
    """

    __slots__ = ()

    def __init__(self, sysid: int, compid: int) -> None:
        super().__init__(_DIALECT, sysid, compid)
