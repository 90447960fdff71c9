"""MAVLink framing in plain Python: what firmware_bridge/native/mavlink_frame.hpp does, count by count."""

from __future__ import annotations

import re
import struct

from fastcrc.crc16 import mcrf4xx

from firmware_bridge.codecs.dialect import SHAPES
from firmware_bridge.codecs.mavlink_frame import Frame

_V2 = 0xFD
_V1 = 0xFE
_IFLAG_SIGNED = 0x01
_SIGNATURE_LENGTH = 13

_start_byte = re.compile(b"[\xfd\xfe]").search
_header_v2 = struct.Struct("<BBBBBBBHB").pack
_crc_bytes = struct.Struct("<H").pack
_ZEROS = bytes(256)
_LATE_GAP = 240  # a sequence number this far ahead is one that is up to 16 behind
_EXTRA_BYTE = tuple(bytes((i,)) for i in range(256))


class FrameParser:
    """As `firmware_bridge.codecs.mavlink_frame.FrameParser`."""

    __slots__ = ("_next_seq", "_pending", "bad_crc", "frames", "garbage_bytes", "lost", "unknown")

    def __init__(self) -> None:
        self._pending = b""
        self._next_seq: dict[int, int] = {}
        self.bad_crc = 0
        self.garbage_bytes = 0
        self.frames = 0
        self.unknown = 0
        self.lost = 0

    @property
    def pending(self) -> int:
        """Bytes held back because they may be the beginning of a frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Frame]:
        """Take `data` and return the frames that it completes."""
        if self._pending:
            data = self._pending + data
        frames, end = self._scan(data, 0)
        self._pending = data[end:]
        return frames

    def rescan(self) -> list[Frame]:
        """Whole frames inside the bytes held back, or [].

        A damaged length byte makes the parser wait for bytes that never come while a good frame sits inside
        what it holds. A caller that sees the line go quiet calls this; if nothing whole is inside, nothing
        changes, so that a frame which is merely slow is not lost.
        """
        pending = self._pending
        counters = (self.bad_crc, self.garbage_bytes, self.unknown)
        frames: list[Frame] = []
        end = 0
        # Each header that waits for more may itself be false: go on behind each of them in turn.
        while not frames and end + 1 < len(pending):
            frames, end = self._scan(pending, end + 1)
        self.bad_crc, self.garbage_bytes, self.unknown = counters
        if frames:
            self.garbage_bytes += end - sum(len(frame.raw) for frame in frames)
            self._pending = pending[end:]
        return frames

    def _scan(self, data: bytes, pos: int) -> tuple[list[Frame], int]:
        """Frames of `data` from `pos` on, and where the bytes begin that must wait for more."""
        found: list[Frame] = []
        size = len(data)
        shapes = SHAPES
        next_seq = self._next_seq
        while pos < size:
            magic = data[pos]
            if magic == _V2:
                if size - pos < 10:
                    break
                length = data[pos + 1]
                incompat = data[pos + 2]
                msgid = data[pos + 7] | data[pos + 8] << 8 | data[pos + 9] << 16
                body = pos + 10
                shape = shapes.get(msgid)
                # The standard: frames with incompatibility flags that one does not know must be thrown away.
                plausible = not incompat & ~_IFLAG_SIGNED
            elif magic == _V1:
                if size - pos < 6:
                    break
                length = data[pos + 1]
                incompat = 0
                msgid = data[pos + 5]
                body = pos + 6
                shape = shapes.get(msgid)
                plausible = shape is None or shape[1] <= length <= shape[2]
            else:
                match = _start_byte(data, pos)
                to = match.start() if match else size
                self.garbage_bytes += to - pos
                pos = to
                continue
            if shape is None or not plausible:
                if shape is None and plausible:
                    self.unknown += 1
                self.garbage_bytes += 1
                pos += 1
                continue
            crc_at = body + length
            end = crc_at + 2
            if incompat:
                end += _SIGNATURE_LENGTH
            if end > size:
                break
            crc = mcrf4xx(data[pos + 1 : crc_at] + _EXTRA_BYTE[shape[0]])
            if crc != data[crc_at] | data[crc_at + 1] << 8:
                self.bad_crc += 1
                self.garbage_bytes += 1
                pos += 1
                continue
            if magic == _V2:
                seq = data[pos + 4]
                sysid = data[pos + 5]
                compid = data[pos + 6]
            else:
                seq = data[pos + 2]
                sysid = data[pos + 3]
                compid = data[pos + 4]
            key = sysid << 8 | compid
            expected = next_seq.get(key, seq)
            gap = (seq - expected) & 0xFF
            if gap < _LATE_GAP:
                self.lost += gap
                next_seq[key] = (seq + 1) & 0xFF
            elif self.lost:
                # PX4 sends from two threads: a frame that comes a little late was counted as lost, and is not.
                self.lost -= 1
            payload = data[body:crc_at]
            if length < shape[2]:
                payload += _ZEROS[: shape[2] - length]
            elif length > shape[2]:
                # A newer sender may know more extension fields: what is behind those known here is not ours.
                payload = payload[: shape[2]]
            found.append(Frame(msgid, sysid, compid, seq, payload, data[pos:end]))
            pos = end
        self.frames += len(found)
        return found, pos


class FrameEncoder:
    """As `firmware_bridge.codecs.mavlink_frame.FrameEncoder`."""

    __slots__ = ("_seq", "compid", "sysid")

    def __init__(self, sysid: int, compid: int) -> None:
        self.sysid = sysid
        self.compid = compid
        self._seq = 0

    def frame(self, msgid: int, payload: bytes) -> bytes:
        """The bytes of one frame.

        `payload` is the whole payload of a message of the dialect (KeyError otherwise).
        """
        seq = self._seq
        self._seq = (seq + 1) & 0xFF
        # At least one byte stays, even if it is zero: the standard's rule.
        cut = payload.rstrip(b"\0") or b"\0"
        body = _header_v2(_V2, len(cut), 0, 0, seq, self.sysid, self.compid, msgid & 0xFFFF, msgid >> 16) + cut
        return body + _crc_bytes(mcrf4xx(body[1:] + _EXTRA_BYTE[SHAPES[msgid][0]]))
