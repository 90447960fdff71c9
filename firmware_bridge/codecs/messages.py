"""Every message of the MAVLink dialect `all` as a plain named tuple.

The field table is pymavlink's dialect (field names, types, wire order, array lengths, extensions, crc_extra). From it
each message gets, on first use, a precompiled `struct.Struct` and a named tuple class. No pymavlink object is made: a
named tuple is two to three times as fast, and compares and hashes by value.

Values are MAVLink's own: NED/FRD and scaled integers, exactly as on the wire. Fields have the order of the dialect, not
of the wire. `char[]` fields are `str`, arrays are tuples of their full length. Extension fields may be omitted when a
message is made; they are then zero.
"""

from __future__ import annotations

import struct
from collections import namedtuple
from collections.abc import Callable
from functools import cache
from operator import itemgetter
from typing import Any

from firmware_bridge.codecs.dialect import MAVLINK_MAP, MSGID, NAME, extension_count, wire_tokens
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame

__all__ = ["MSGID", "NAME", "message_class", "pack", "unpack"]

_Packer = Callable[[tuple[Any, ...]], bytes]
_Unpacker = Callable[[bytes], Any]


class _Codec:
    """Packer and unpacker of one message, built once from the dialect."""

    __slots__ = ("cls", "fields", "pack", "unpack")

    def __init__(self, name: str) -> None:
        msgid = MSGID[name]
        m = MAVLINK_MAP[msgid]
        wire = struct.Struct(m.unpacker.format)
        tokens = wire_tokens(msgid)
        # One row per field in dialect order: (name, place on the wire, element count or 0, type letter)
        self.fields = [(field, order, *tokens[order]) for field, order in zip(m.fieldnames, m.orders, strict=True)]
        optional = self.fields[len(tokens) - extension_count(msgid) :]
        defaults = [self._zero(count, kind) for _, _, count, kind in optional]
        cls: Any = namedtuple(name, m.fieldnames, defaults=defaults)  # type: ignore[misc]
        cls.MSGID = msgid  # type: ignore[attr-defined]
        cls.__module__ = __name__
        self.cls = cls
        self.pack, self.unpack = self._build(cls, wire, len(tokens))

    @staticmethod
    def _zero(count: int, kind: str) -> Any:
        if kind == "s":
            return ""
        return (0,) * count if count else 0

    def _build(self, cls: Any, wire: struct.Struct, n: int) -> tuple[_Packer, _Unpacker]:
        pack, unpack, size = wire.pack, wire.unpack_from, wire.size
        orders = [order for _, order, _, _ in self.fields]
        plain = not any(count for _, _, count, _ in self.fields)
        if plain and orders == sorted(orders):
            return lambda msg: pack(*msg), lambda payload: cls._make(unpack(payload))
        if plain:
            # Inverse permutation: to_wire[k] = dialect place of the field at place k on the wire.
            to_wire = itemgetter(*sorted(range(n), key=orders.__getitem__))
            from_wire = itemgetter(*orders)
            return lambda msg: pack(*to_wire(msg)), lambda payload: cls._make(from_wire(unpack(payload)))

        by_wire = sorted(((order, i, count, kind) for i, (_, order, count, kind) in enumerate(self.fields)))

        def pack_arrays(msg: tuple[Any, ...]) -> bytes:
            values: list[Any] = []
            for _, i, count, kind in by_wire:
                value = msg[i]
                if kind == "s":
                    data = value.encode() if isinstance(value, str) else bytes(value)
                    if len(data) > count:
                        raise struct.error(f"{len(data)} bytes of text, at most {count}")
                    values.append(data)
                elif count:
                    if len(value) != count:
                        raise struct.error(f"{len(value)} elements, must be {count}")
                    values.extend(value)
                else:
                    values.append(value)
            return pack(*values)

        slices: list[tuple[int, int, str]] = [(0, 0, "")] * n
        at = 0
        for _, i, count, kind in by_wire:
            slices[i] = (at, count, kind)
            at += 1 if kind == "s" else max(count, 1)

        def unpack_arrays(payload: bytes) -> Any:
            flat = unpack(payload)
            values: list[Any] = []
            for start, count, kind in slices:
                if kind == "s":
                    # A text ends at its first NUL; invalid UTF-8 must not end a run.
                    values.append(flat[start].split(b"\0", 1)[0].decode("utf-8", "replace"))
                elif count:
                    values.append(flat[start : start + count])
                else:
                    values.append(flat[start])
            return cls._make(values)

        assert at == len(unpack(bytes(size)))
        return pack_arrays, unpack_arrays


_codecs: dict[int, _Codec] = {}


def _codec(msgid: int) -> _Codec:
    try:
        return _codecs[msgid]
    except KeyError:
        name = NAME.get(msgid)
        if name is None:
            raise CodecError(f"message id {msgid} is not in the MAVLink dialect `all`") from None
        codec = _codecs[msgid] = _Codec(name)
        return codec


def message_class(name: str) -> Any:
    """Return the named tuple class of message `name`, always the same object.

    Its class attribute `MSGID` is the message id. CodecError if the message is unknown.
    """
    msgid = MSGID.get(name)
    if msgid is None:
        raise CodecError(f"message {name!r} is not in the MAVLink dialect `all`")
    return _codec(msgid).cls


def pack(msg: Any) -> bytes:
    """Return the payload of `msg`, all fields, not truncated.

    CodecError names the first field whose value does not fit.
    """
    codec = _codec(msg.MSGID)
    try:
        return codec.pack(msg)
    except (struct.error, OverflowError, TypeError, AttributeError) as error:
        raise CodecError(_blame(codec, msg) or f"{type(msg).__name__}: {error}") from error


def unpack(frame: Frame) -> Any:
    """Return the message in `frame`, an instance of its named tuple class.

    CodecError for an id outside the dialect.
    """
    codec = _codecs.get(frame[0]) or _codec(frame[0])
    try:
        return codec.unpack(frame[4])
    except struct.error as error:
        raise CodecError(f"{codec.cls.__name__}: payload of {len(frame[4])} bytes is too short") from error


def _blame(codec: _Codec, msg: tuple[Any, ...]) -> str | None:
    """Describe the first field of `msg` that does not fit; None if each fits by itself."""
    for (field, _, count, kind), value in zip(codec.fields, msg, strict=False):
        where = f"{codec.cls.__name__}.{field}"
        try:
            if kind == "s":
                size = len(value.encode() if isinstance(value, str) else bytes(value))
                if size > count:
                    return f"{where}: {size} bytes of text, at most {count}"
            elif count:
                if len(value) != count:
                    return f"{where}: {len(value)} elements, must be {count}"
                struct.pack(f"<{count}{kind}", *value)
            else:
                struct.pack(f"<{kind}", value)
        except (struct.error, OverflowError, TypeError, AttributeError) as error:
            return f"{where} = {value!r}: {error}"
    return None


@cache
def _target_offsets(msgid: int) -> tuple[int | None, int | None]:
    """Return the payload offsets of `target_system` and `target_component`; None for a missing field."""
    message = MAVLINK_MAP.get(msgid)

    def offset(field: str) -> int | None:
        if message is None or field not in message.fieldnames:
            return None
        before = wire_tokens(msgid)[: message.orders[message.fieldnames.index(field)]]
        return struct.calcsize("<" + "".join(f"{count or 1}{kind}" for count, kind in before))

    return offset("target_system"), offset("target_component")


def target(frame: Frame) -> tuple[int, int]:
    """Return (system, component) that `frame` is addressed to; zeros for a broadcast or a message without targets."""
    system, component = _target_offsets(frame[0])
    if system is None:
        return (0, 0)
    payload = frame[4]
    return payload[system], 0 if component is None else payload[component]
