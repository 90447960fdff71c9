"""Whom a message is for: where `target_system` and `target_component` stand in each message that has them."""

from __future__ import annotations

from firmware_bridge.codecs.dialect import MAVLINK_MAP, wire_tokens
from firmware_bridge.codecs.mavlink_frame import Frame

_SIZES = {"c": 1, "s": 1, "b": 1, "B": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8}


def _offset(msgid: int, field: str) -> int | None:
    """Byte of the payload at which `field` begins; None where the message has no such field."""
    message = MAVLINK_MAP[msgid]
    if field not in message.fieldnames:
        return None
    place = message.orders[message.fieldnames.index(field)]
    return sum((count or 1) * _SIZES[kind] for count, kind in wire_tokens(msgid)[:place])


def _offsets() -> dict[int, tuple[int, int | None]]:
    found = {}
    for msgid in MAVLINK_MAP:
        system = _offset(msgid, "target_system")
        if system is not None:
            found[msgid] = (system, _offset(msgid, "target_component"))
    return found


_OFFSETS = _offsets()


def target(frame: Frame) -> tuple[int, int]:
    """(system, component) that `frame` is addressed to. A zero is everybody, and so is a message without targets."""
    offsets = _OFFSETS.get(frame[0])
    if offsets is None:
        return (0, 0)
    system, component = offsets
    payload = frame[4]
    return payload[system], 0 if component is None else payload[component]
