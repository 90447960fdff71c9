"""Cuts a byte stream into the units that message faults hit: whole MAVLink frames, and single bytes between them.

A frame is a start byte, a header that makes sense, and as many bytes as its length says; if the message is known, its
checksum must fit as well. Frames of unknown messages (other dialects) are taken by their length. MAVLink 1 and 2,
signed or not. All bytes come out, in their order: the units put together are the stream.
"""

from __future__ import annotations

import re

from fastcrc.crc16 import mcrf4xx

from firmware_bridge.codecs.dialect import NAME, SHAPES

_V2, _V1 = 0xFD, 0xFE
_HEADER = {_V2: 10, _V1: 6}
_SIGNED = 0x01
_SIGNATURE_LENGTH = 13
_CRC_LENGTH = 2
_start_byte = re.compile(b"[\xfd\xfe]").search


def message_id(unit: bytes) -> int | None:
    """The message id of a unit, None if it is no frame."""
    magic = unit[0]
    if len(unit) <= _HEADER.get(magic, len(unit)):
        return None
    return int.from_bytes(unit[7:10], "little") if magic == _V2 else unit[5]


def describe(unit: bytes) -> str:
    """A unit in words."""
    msgid = message_id(unit)
    if msgid is None:
        return f"byte 0x{unit.hex()}" if len(unit) == 1 else f"{len(unit)} bytes"
    return NAME.get(msgid, f"message {msgid}")


class FrameSplitter:
    """Incremental. Holds back at most one frame's beginning, which `flush` gives up waiting for."""

    __slots__ = ("_pending",)

    def __init__(self) -> None:
        self._pending = b""

    @property
    def pending(self) -> int:
        """Bytes held back because they may be the beginning of a frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[bytes]:
        """Take `data` and return the units that are complete."""
        data = self._pending + data
        units, end = self._scan(data, last=False)
        self._pending = data[end:]
        return units

    def flush(self) -> list[bytes]:
        """All that is held back, as units: nothing more will come."""
        units, _ = self._scan(self._pending, last=True)
        self._pending = b""
        return units

    def clear(self) -> None:
        """Forget what is held back."""
        self._pending = b""

    @staticmethod
    def _scan(data: bytes, *, last: bool) -> tuple[list[bytes], int]:
        """Units of `data`, and where the bytes begin that must wait for more."""
        units: list[bytes] = []
        pos, size = 0, len(data)
        while pos < size:
            if data[pos] not in _HEADER:
                match = _start_byte(data, pos)
                to = match.start() if match else size
                units += [data[i : i + 1] for i in range(pos, to)]
                pos = to
                continue
            end = _frame_end(data, pos)
            if end > size and not last:
                break
            if not pos < end <= size:
                end = pos + 1
            units.append(data[pos:end])
            pos = end
        return units, pos


def _frame_end(data: bytes, pos: int) -> int:
    """Where the frame that starts at `pos` ends: beyond `data` if it is not all there, `pos` if it is none."""
    magic = data[pos]
    body = pos + _HEADER[magic]
    if body > len(data):
        return body
    if magic == _V2:
        incompat = data[pos + 2]
        if incompat & ~_SIGNED:
            return pos
        msgid = int.from_bytes(data[pos + 7 : body], "little")
    else:
        incompat = 0
        msgid = data[pos + 5]
    crc_at = body + data[pos + 1]
    end = crc_at + _CRC_LENGTH + (_SIGNATURE_LENGTH if incompat else 0)
    if end > len(data):
        return end
    shape = SHAPES.get(msgid)
    if shape is not None:
        crc = mcrf4xx(data[pos + 1 : crc_at] + bytes((shape.crc_extra,)))
        if crc != int.from_bytes(data[crc_at : crc_at + _CRC_LENGTH], "little"):
            return pos
    return end
