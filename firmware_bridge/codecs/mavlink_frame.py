"""MAVLink framing: bytes to checked frames and back.

MAVLink 2 (0xFD, https://mavlink.io/en/guide/serialization.html):
    FD len incompat compat seq sysid compid msgid[3] payload[len] crc[2] (signature[13] if incompat & 1)
MAVLink 1 (0xFE):
    FE len seq sysid compid msgid payload[len] crc[2]
crc is CRC-16/MCRF4XX over everything after the start byte up to the payload's end, then over the message's
crc_extra. MAVLink 2 senders truncate zero bytes at the payload's end; receivers restore them.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

from fastcrc.crc16 import mcrf4xx

from firmware_bridge.codecs.dialect import SHAPES

_V2, _V1 = 0xFD, 0xFE
_HEADER_LENGTH = {_V2: 10, _V1: 6}
_SIGNED = 0x01  # incompatibility flag
_CRC_LENGTH, _SIGNATURE_LENGTH = 2, 13
MAX_FRAME_LENGTH = 10 + 255 + _CRC_LENGTH + _SIGNATURE_LENGTH
_DATAGRAM_LIMIT = 1400  # bytes; PX4 reads datagrams of at most 1600
NO_FRAME = 0xFFFFFFFF  # message id of bytes outside of frames

_LATE_GAP = 240  # gaps from this on are late frames, up to 16 behind (modulo 256)
_ZEROS = bytes(256)
_EXTRA_BYTE = {msgid: bytes((shape.crc_extra,)) for msgid, shape in SHAPES.items()}
_start_byte = re.compile(b"[\xfd\xfe]").search
_header_v2 = struct.Struct("<BBBBBBBHB").pack
_read_v2 = struct.Struct("<xBBxBBBHB").unpack_from  # length, incompat, seq, sysid, compid, low and high bits of msgid
_read_v1 = struct.Struct("<xBBBBB").unpack_from  # length, seq, sysid, compid, msgid
_crc_bytes = struct.Struct("<H").pack


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


_new_frame = tuple.__new__  # without the calls of `Frame(...)`


class FrameParser:
    """Incremental parser of one byte stream.

    Never raises. Frames come out in stream order and depend on the stream only, not on its division into chunks. At
    most `MAX_FRAME_LENGTH` - 1 bytes are held back. Time is linear in the bytes fed.

    After a false start byte the search continues with the next byte, so that a true frame inside a false one is not
    lost. Counters: `frames` good ones; `bad_crc` plausible headers whose checksum failed; `unknown` headers with a
    message id outside the dialect; `garbage_bytes` bytes outside of good frames; `lost` gaps in the sequence numbers,
    per (sysid, compid).
    """

    __slots__ = ("_next_seq", "_pending", "bad_crc", "frames", "garbage_bytes", "lost", "unknown")

    def __init__(self) -> None:
        self._pending = b""
        self._next_seq: dict[int, int] = {}
        self.bad_crc = self.frames = self.garbage_bytes = self.lost = self.unknown = 0

    @property
    def pending(self) -> int:
        """Number of bytes held back because they may begin a frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Frame]:
        """Take `data` and return the frames that it completes."""
        if self._pending:
            data = self._pending + data
        frames, end = self._scan(data, 0)
        self._pending = data[end:]
        return frames

    def rescan(self) -> list[Frame]:
        """Return whole frames inside the bytes held back, or [].

        After a damaged length byte the parser waits for bytes that never come, with good frames among the bytes that it
        holds. A caller calls this when the line is quiet. Without a whole frame inside, the held bytes stay, so that a
        slow frame is not lost.
        """
        pending = self._pending
        counters = (self.bad_crc, self.garbage_bytes, self.unknown)
        frames: list[Frame] = []
        end = 0
        # Each header that waits for more bytes may be false: continue after each of them in turn.
        while not frames and end + 1 < len(pending):
            frames, end = self._scan(pending, end + 1)
        self.bad_crc, self.garbage_bytes, self.unknown = counters
        if frames:
            self.garbage_bytes += end - sum(len(frame.raw) for frame in frames)
            self._pending = pending[end:]
        return frames

    def _scan(self, data: bytes, pos: int) -> tuple[list[Frame], int]:
        """Return the frames of `data` from `pos` on, and the index of the bytes that must wait for more."""
        found: list[Frame] = []
        size = len(data)
        next_seq = self._next_seq
        while pos < size:
            magic = data[pos]
            if magic == _V2:
                body = pos + 10
                if body > size:
                    break
                length, incompat, seq, sysid, compid, low, high = _read_v2(data, pos)
                msgid = low | high << 16
                crc_at = body + length
                end = crc_at + _CRC_LENGTH
                if incompat == _SIGNED:
                    end += _SIGNATURE_LENGTH
                elif incompat:
                    msgid = NO_FRAME
            elif magic == _V1:
                body = pos + 6
                if body > size:
                    break
                length, seq, sysid, compid, msgid = _read_v1(data, pos)
                crc_at = body + length
                end = crc_at + _CRC_LENGTH
            else:
                match = _start_byte(data, pos)
                to = match.start() if match else size
                self.garbage_bytes += to - pos
                pos = to
                continue
            shape = SHAPES.get(msgid)
            # MAVLink 1 truncates no zeros, so its length must fit as well.
            if shape is None or (magic == _V1 and not shape[1] <= length <= shape[2]):
                self.unknown += shape is None and msgid != NO_FRAME
                self.garbage_bytes += 1
                pos += 1
                continue
            if end > size:
                break
            if mcrf4xx(data[pos + 1 : crc_at] + _EXTRA_BYTE[msgid]) != data[crc_at] | data[crc_at + 1] << 8:
                self.bad_crc += 1
                self.garbage_bytes += 1
                pos += 1
                continue
            sender = sysid << 8 | compid
            if next_seq.get(sender) == seq:
                next_seq[sender] = (seq + 1) & 0xFF
            else:
                self._count_gap(sender, seq)
            missing = shape[2] - length
            # A newer sender may have more extension fields than are known here; they are ignored.
            payload = data[body:crc_at] + _ZEROS[:missing] if missing > 0 else data[body : crc_at + missing]
            found.append(_new_frame(Frame, (msgid, sysid, compid, seq, payload, data[pos:end])))
            self.frames += 1
            pos = end
        return found, pos

    def _count_gap(self, sender: int, seq: int) -> None:
        gap = (seq - self._next_seq.get(sender, seq)) & 0xFF
        if gap < _LATE_GAP:
            self.lost += gap
            self._next_seq[sender] = (seq + 1) & 0xFF
        elif self.lost:
            # PX4 sends from two threads: a frame that comes a little late was counted as lost before.
            self.lost -= 1


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
        pieces, end = _pieces(data, last=False)
        self._pending = data[end:]
        return [unit for _, unit in pieces]

    def flush(self) -> list[bytes]:
        """Return the bytes held back as units: no more bytes will come."""
        pieces, _ = _pieces(self._pending, last=True)
        self._pending = b""
        return [unit for _, unit in pieces]

    def clear(self) -> None:
        """Drop the bytes held back."""
        self._pending = b""


def _pieces(data: bytes, *, last: bool) -> tuple[list[tuple[int, bytes]], int]:
    """Return (message id, unit) of each unit of `data`, and the index of bytes that must wait, unless `last`."""
    found: list[tuple[int, bytes]] = []
    pos, size = 0, len(data)
    while pos < size:
        magic = data[pos]
        header = _HEADER_LENGTH.get(magic)
        if header is None:
            match = _start_byte(data, pos)
            to = match.start() if match else size
            found += [(NO_FRAME, data[i : i + 1]) for i in range(pos, to)]
            pos = to
            continue
        body = pos + header
        msgid, end = NO_FRAME, size + 1  # needs more bytes
        if body <= size:
            if magic == _V2:
                length, incompat, _, _, _, low, high = _read_v2(data, pos)
                msgid = low | high << 16
            else:
                length, _, _, _, msgid = _read_v1(data, pos)
                incompat = 0
            crc_at = body + length
            end = crc_at + (_CRC_LENGTH + _SIGNATURE_LENGTH if incompat else _CRC_LENGTH)
            extra_byte = _EXTRA_BYTE.get(msgid)
            if incompat & ~_SIGNED or (
                end <= size
                and extra_byte is not None
                and mcrf4xx(data[pos + 1 : crc_at] + extra_byte) != data[crc_at] | data[crc_at + 1] << 8
            ):
                msgid, end = NO_FRAME, pos + 1
        if end > size:
            if not last:
                break
            msgid, end = NO_FRAME, pos + 1
        found.append((msgid, data[pos:end]))
        pos = end
    return found, pos


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
    pieces, _ = _pieces(data, last=True)
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
    return body + _crc_bytes(mcrf4xx(body[1:] + _EXTRA_BYTE[msgid]))


class FrameEncoder:
    """Makes the frames of one sender and holds its sequence number.

    MAVLink 2, unsigned, trailing zeros truncated.
    """

    __slots__ = ("_seq", "compid", "sysid")

    def __init__(self, sysid: int, compid: int) -> None:
        if not (1 <= sysid <= 255 and 1 <= compid <= 255):
            raise ValueError(f"sysid and compid must be 1..255, not {sysid} and {compid}")
        self.sysid = sysid
        self.compid = compid
        self._seq = 0

    def frame(self, msgid: int, payload: bytes) -> bytes:
        """Return the bytes of one frame.

        `payload` is the whole payload of a message of the dialect (KeyError for another id).
        """
        extra_byte = _EXTRA_BYTE[msgid]
        # The standard keeps at least one byte, even if it is zero.
        cut = payload.rstrip(b"\0") or b"\0"
        if len(payload) > 255:
            raise ValueError("a payload has at most 255 bytes")
        seq = self._seq
        self._seq = (seq + 1) & 0xFF
        body = _header_v2(_V2, len(cut), 0, 0, seq, self.sysid, self.compid, msgid & 0xFFFF, msgid >> 16) + cut
        return body + _crc_bytes(mcrf4xx(body[1:] + extra_byte))
