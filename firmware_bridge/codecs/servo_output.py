"""SERVO_OUTPUT_RAW: the pulse widths with which an autopilot drives its outputs, before any lag of ESC or motor."""

from __future__ import annotations

import struct

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID

SERVO_OUTPUT_RAW = MSGID["SERVO_OUTPUT_RAW"]

_unpack = struct.Struct("<I8HB8H").unpack_from
_LENGTH = 37
_TIME_WRAP_US = 1 << 32
_ORDER_US = 1_000_000  # what is back by less has been overtaken on its way
_PAUSE_US = 60_000_000  # longest silence in which it may have wrapped


def servo_output(frame: Frame) -> tuple[int, tuple[int, ...]] | None:
    """(time since boot [us], pulse widths [us] of outputs 1 to 16, 0: none). None if the frame has outputs 17 to 32.

    A sender that knows only eight outputs (MAVLink 1) leaves the others 0.
    """
    payload = frame[4]
    values = _unpack(payload if len(payload) >= _LENGTH else payload + bytes(_LENGTH - len(payload)))
    return None if values[9] != 0 else (values[0], values[1:9] + values[10:18])


def began_anew(before_us: int, after_us: int) -> bool:
    """Whether the time since boot fell back: a reboot. It wraps after 71.6 minutes, which is none."""
    back_us = before_us - after_us
    return _ORDER_US < back_us < _TIME_WRAP_US - _PAUSE_US
