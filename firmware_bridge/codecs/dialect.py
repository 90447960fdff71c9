"""The one field table: pymavlink's `all` dialect, and what framing and packing need of it.

`all` holds `common` and what PX4 (`development`) and ArduPilot (`ardupilotmega`) say besides: a message that framing
does not know cannot be checked, and so could not be handed on to a ground station. Importing it costs about 60 ms
once; nothing here makes a pymavlink message object.
"""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from firmware_bridge.codecs.framing_only import FRAMING_ONLY

# TEST_TYPES is for testing generators and never on a wire.
MAVLINK_MAP: dict[int, Any] = {i: m for i, m in dialect.mavlink_map.items() if m.msgname != "TEST_TYPES"}
MSGID: dict[str, int] = {m.msgname: msgid for msgid, m in MAVLINK_MAP.items()}
NAME: dict[int, str] = {msgid: name for name, msgid in MSGID.items()}


class MessageShape(NamedTuple):
    """What framing needs to know of a message: lengths in bytes without and with extension fields, and crc_extra."""

    crc_extra: int
    base_length: int
    length: int


def wire_tokens(msgid: int) -> list[tuple[int, str]]:
    """(element count, 0 for a scalar; `struct` type letter) of every field of a message, in wire order."""
    found = re.findall(r"(\d*)([a-zA-Z])", MAVLINK_MAP[msgid].unpacker.format)
    return [(int(count or 0), kind) for count, kind in found]


def extension_count(msgid: int) -> int:
    """How many fields are MAVLink 2 extensions: the last ones on the wire, those with a default."""
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
