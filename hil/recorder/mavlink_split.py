"""Where one MAVLink frame ends and the next begins, without checking or decoding either."""

from __future__ import annotations

import re

_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_SIGNED = 0x01  # incompatibility flag: 13 bytes of signature follow the checksum
NO_FRAME = 0xFFFFFFFF  # stands for the message id of bytes that are no frame


_start_byte = re.compile(b"[\xfd\xfe]").search


def split_frames(data: bytes) -> list[tuple[int, bytes]]:
    """(message id, frame) of every frame in `data`, in order.

    Bytes that are no frame (injected faults, a cut frame) come as one piece with id `NO_FRAME`: nothing that went
    over the wire is left out, and joining the pieces gives `data` again.
    """
    size = len(data)
    found: list[tuple[int, bytes]] = []
    at = 0
    while at < size:
        magic = data[at]
        left = size - at
        if magic == _MAVLINK_2 and left >= 12:
            end = at + 12 + data[at + 1] + (13 if data[at + 2] & _SIGNED else 0)
            msgid = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        elif magic == _MAVLINK_1 and left >= 8:
            end = at + 8 + data[at + 1]
            msgid = data[at + 5]
        else:
            end, msgid = size + 1, NO_FRAME
        if end > size:
            start = _start_byte(data, at + 1)
            end, msgid = start.start() if start else size, NO_FRAME
        if msgid == NO_FRAME and found and found[-1][0] == NO_FRAME:
            found[-1] = (NO_FRAME, found[-1][1] + data[at:end])
        else:
            found.append((msgid, data[at:end] if at or end < size else data))
        at = end
    return found
