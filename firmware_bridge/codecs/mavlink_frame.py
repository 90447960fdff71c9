"""MAVLink framing: bytes to checked frames and back.

MAVLink 2 (0xFD, https://mavlink.io/en/guide/serialization.html):
    FD len incompat compat seq sysid compid msgid[3] payload[len] crc[2] (signature[13] if incompat & 1)
MAVLink 1 (0xFE):
    FE len seq sysid compid msgid payload[len] crc[2]
crc is CRC-16/MCRF4XX over everything after the start byte up to the payload's end, then over the message's
crc_extra. MAVLink 2 senders truncate zero bytes at the payload's end; receivers restore them.

The bytes are read and made in firmware_bridge/native/mavlink_frame.hpp.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

from firmware_bridge import _native
from firmware_bridge.codecs.dialect import SHAPES

_V2, _V1 = 0xFD, 0xFE
_HEADER_LENGTH = {_V2: 10, _V1: 6}
MAX_FRAME_LENGTH = 10 + 255 + 2 + 13  # header, payload, checksum, signature
_DATAGRAM_LIMIT = 1400  # bytes; PX4 reads datagrams of at most 1600
NO_FRAME = 0xFFFFFFFF  # message id of bytes outside of frames


class Frame(NamedTuple):
    """One checked frame.

    `payload` has the message's full length, truncated zeros restored; `raw` has the bytes as received.
    """

    msgid: int
    sysid: int
    compid: int
    seq: int
    payload: bytes
    raw: bytes


_DIALECT = _native.MavlinkDialect(SHAPES, Frame)


class FrameParser(_native.FrameParser):
    """Incremental parser of one byte stream.

    `feed(data)` never raises and returns the frames that `data` completes. Frames come out in stream order and depend
    on the stream only, not on its division into chunks. At most `MAX_FRAME_LENGTH` - 1 bytes are held back (`pending`).
    Time is linear in the bytes fed.

    `rescan()` returns whole frames inside the bytes held back, or []. After a damaged length byte the parser waits for
    bytes that never come, with good frames among the bytes that it holds. A caller calls this when the line is quiet.
    Without a whole frame inside, the held bytes stay, so that a slow frame is not lost.

    After a false start byte the search continues with the next byte, so that a true frame inside a false one is not
    lost. Counters: `frames` good ones; `bad_crc` plausible headers whose checksum failed; `unknown` headers with a
    message id outside the dialect; `garbage_bytes` bytes outside of good frames; `lost` gaps in the sequence numbers,
    per (sysid, compid).
    """

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__(_DIALECT)


class FrameSplitter:
    """Splits a byte stream into units: whole frames, and the single bytes between them.

    Unlike the parser it takes frames of unknown messages (other dialects) by their length, and drops no byte: all come
    out, in order. Incremental: holds back at most the beginning of one frame, which `flush` releases.
    """

    __slots__ = ("_pending",)

    def __init__(self) -> None:
        self._pending = b""

    @property
    def pending(self) -> int:
        """Number of bytes held back because they may begin a frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[bytes]:
        """Take `data` and return the units that are complete."""
        data = self._pending + data
        pieces, end = _DIALECT.split(data, last=False)
        self._pending = data[end:]
        return [unit for _, unit in pieces]

    def flush(self) -> list[bytes]:
        """Return the bytes held back as units: no more bytes will come."""
        pieces, _ = _DIALECT.split(self._pending, last=True)
        self._pending = b""
        return [unit for _, unit in pieces]

    def clear(self) -> None:
        """Drop the bytes held back."""
        self._pending = b""


def message_id(unit: bytes) -> int:
    """Return the message id of a unit, damaged or not; `NO_FRAME` if it has no header."""
    if len(unit) <= _HEADER_LENGTH.get(unit[0], len(unit)):
        return NO_FRAME
    return int.from_bytes(unit[7:10], "little") if unit[0] == _V2 else unit[5]


def split_frames(data: bytes) -> list[tuple[int, bytes]]:
    """Return (message id, frame) of every frame in `data`, in order.

    Bytes outside of frames (of a damaged or truncated one) come as one piece with id `NO_FRAME`: the joined pieces are
    `data` again.
    """
    pieces, _ = _DIALECT.split(data, last=True)
    if NO_FRAME not in dict(pieces):
        return pieces
    joined: list[tuple[int, bytes]] = []
    for is_stray, group in groupby(pieces, key=lambda piece: piece[0] == NO_FRAME):
        units = list(group)
        joined += [(NO_FRAME, b"".join(unit for _, unit in units))] if is_stray else units
    return joined


def datagrams(frames: Iterable[bytes]) -> Iterator[tuple[bytes, int]]:
    """Pack whole frames into datagrams below any MTU: yields (bytes, number of frames)."""
    batch: list[bytes] = []
    size = 0
    for raw in frames:
        if batch and size + len(raw) > _DATAGRAM_LIMIT:
            yield b"".join(batch), len(batch)
            batch, size = [], 0
        batch.append(raw)
        size += len(raw)
    if batch:
        yield b"".join(batch), len(batch)


def with_checksum(body: bytes, msgid: int) -> bytes:
    """Return a frame, given from start byte to payload, with its checksum appended."""
    return _DIALECT.with_checksum(body, msgid)


class FrameEncoder(_native.FrameEncoder):
    """Makes the frames of one sender and holds its sequence number.

    MAVLink 2, unsigned, trailing zeros truncated. `frame(msgid, payload)` returns the bytes of one frame; `payload` is
    the whole payload of a message of the dialect (KeyError for another id).
    """

    __slots__ = ()

    def __init__(self, sysid: int, compid: int) -> None:
        """ValueError unless both are 1..255."""
        super().__init__(_DIALECT, sysid, compid)
