"""The field table of all messages: pymavlink's `all` dialect, reduced to the needs of framing and packing.

`all` has `common` and the further messages of PX4 (`development`) and ArduPilot (`ardupilotmega`): the checksum of an
unknown message cannot be verified, so such a message could not be forwarded to a ground station. The import takes about
60 ms once. No pymavlink message object is made.
"""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import all as dialect

# TEST_TYPES only serves to test code generators.
MAVLINK_MAP: dict[int, Any] = {i: m for i, m in dialect.mavlink_map.items() if m.msgname != "TEST_TYPES"}
MSGID: dict[str, int] = {m.msgname: msgid for msgid, m in MAVLINK_MAP.items()}
NAME: dict[int, str] = {msgid: name for name, msgid in MSGID.items()}


# Messages that pymavlink omits (work in progress in MAVLink's XML) but autopilots send. Their frames are checked,
# counted and forwarded to ground stations, and never unpacked here. Source: MAVLink message definitions
# `common`, `minimal` and `development` of August 2025; (crc_extra, length without extensions, length) follow from the
# definition by MAVLink's own rule.
FRAMING_ONLY: dict[int, tuple[str, int, int, int]] = {
    8: ("LINK_NODE_STATUS", 117, 36, 36),
    80: ("COMMAND_CANCEL", 14, 4, 4),
    290: ("ESC_INFO", 251, 46, 46),
    291: ("ESC_STATUS", 10, 57, 57),
    300: ("PROTOCOL_VERSION", 217, 22, 22),
    334: ("CELLULAR_STATUS", 72, 10, 10),
    336: ("CELLULAR_CONFIG", 245, 84, 84),
    354: ("SET_VELOCITY_LIMITS", 210, 14, 14),
    355: ("VELOCITY_LIMITS", 6, 12, 12),
    361: ("FIGURE_EIGHT_EXECUTION_STATUS", 93, 33, 33),
    369: ("BATTERY_STATUS_V2", 151, 24, 24),
    371: ("FUEL_STATUS", 10, 26, 26),
    372: ("BATTERY_INFO", 26, 140, 140),
    380: ("TIME_ESTIMATE_TO_TARGET", 232, 20, 20),
    395: ("COMPONENT_INFORMATION", 0, 212, 212),
    396: ("COMPONENT_INFORMATION_BASIC", 50, 160, 160),
    397: ("COMPONENT_METADATA", 182, 108, 108),
    400: ("PLAY_TUNE_V2", 110, 254, 254),
    401: ("SUPPORTED_TUNES", 183, 6, 6),
    410: ("EVENT", 160, 53, 53),
    411: ("CURRENT_EVENT_SEQUENCE", 106, 3, 3),
    412: ("REQUEST_EVENT", 33, 6, 6),
    413: ("RESPONSE_EVENT_ERROR", 77, 7, 7),
    414: ("GROUP_START", 109, 16, 16),
    415: ("GROUP_END", 161, 16, 16),
    440: ("ILLUMINATOR_STATUS", 66, 35, 35),
    510: ("TARGET_ABSOLUTE", 245, 106, 106),
    511: ("TARGET_RELATIVE", 28, 71, 71),
    512: ("CONTROL_STATUS", 184, 2, 2),
}


class MessageShape(NamedTuple):
    """The facts of a message that framing needs: crc_extra, and lengths [bytes] without and with extension fields."""

    crc_extra: int
    base_length: int
    length: int


def wire_tokens(msgid: int) -> list[tuple[int, str]]:
    """Return (element count, 0 for a scalar; `struct` type letter) of every field of a message, in wire order."""
    found = re.findall(r"(\d*)([a-zA-Z])", MAVLINK_MAP[msgid].unpacker.format)
    return [(int(count or 0), kind) for count, kind in found]


def extension_count(msgid: int) -> int:
    """Return the number of MAVLink 2 extension fields, the last ones on the wire."""
    return len(MAVLINK_MAP[msgid].__init__.__defaults__ or ())


def _shape(msgid: int) -> MessageShape:
    m = MAVLINK_MAP[msgid]
    tokens = wire_tokens(msgid)
    base = tokens[: len(tokens) - extension_count(msgid)]
    base_length = struct.calcsize("<" + "".join(f"{count or 1}{kind}" for count, kind in base))
    return MessageShape(crc_extra=m.crc_extra, base_length=base_length, length=m.unpacker.size)


SHAPES: dict[int, MessageShape] = {msgid: MessageShape(*shape) for msgid, (_, *shape) in FRAMING_ONLY.items()} | {
    msgid: _shape(msgid) for msgid in MAVLINK_MAP
}
