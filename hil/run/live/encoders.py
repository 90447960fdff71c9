"""Encoders of one topic: a sample becomes the CDR bytes of a ROS 2 message, while the run flies.

The layout of a topic is computed once by `Layout`, the recording's own, so that a live message has the bytes of the
recorded one. Per message the constant bytes are copied and the fields written by a few `struct` calls: 1 to 2 us
instead of 15 to 40 us for a numpy record of one row.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from hil.run.recorder.mcap.cdr import CDR_HEADER, MESSAGE_PREFIX, Layout, place_of
from hil.run.recorder.mcap.topics import Topic, value_of
from signals.time import NS_PER_S

_CLOCK = struct.Struct("<4siI")


class _Field(NamedTuple):
    offset: int  # in the CDR bytes
    code: str  # of struct
    is_vector: bool
    value: Callable[[Any], Any]


class _Group(NamedTuple):
    """Fields without a gap between them, written by one call."""

    pack: Callable[..., None]
    offset: int
    values: tuple[tuple[bool, Callable[[Any], Any]], ...]


def _grouped(fields: list[_Field]) -> list[_Group]:
    groups: list[list[_Field]] = []
    end = -1
    for field in sorted(fields):
        if field.offset == end:
            groups[-1].append(field)
        else:
            groups.append([field])
        end = field.offset + struct.calcsize("<" + field.code)
    return [
        _Group(
            struct.Struct("<" + "".join(field.code for field in group)).pack_into,
            group[0].offset,
            tuple((field.is_vector, field.value) for field in group),
        )
        for group in groups
    ]


def padded(data: bytes, multiple: int) -> bytes:
    """Return `data` with zero bytes up to a multiple of a size."""
    rest = -len(data) % multiple
    return data + bytes(rest) if rest else data


def clock(t_ns: int) -> bytes:
    """Return a rosgraph_msgs/Clock."""
    seconds, nanoseconds = divmod(t_ns, NS_PER_S)
    return _CLOCK.pack(CDR_HEADER, seconds, nanoseconds)


class SampleEncoder:
    """Encodes samples of one type as messages of one topic."""

    def __init__(self, topic: Topic, frame_id: str, child_frame_id: str, first: Any, pad_to: int) -> None:
        """`first`: a sample; it gives the lengths."""
        kind = type(first)
        strings = {f"{topic.header}.frame_id": frame_id}
        lengths = {path: len(value_of(kind, column)(first)) for path, column in topic.lengths.items()}
        if topic.child_frame:
            prefix = topic.header.removesuffix("header")
            strings[f"{prefix}child_frame_id"] = child_frame_id
            lengths[prefix.removesuffix("[0].")] = 1
        for path in ("location", "serial_number"):  # of a BatteryState
            strings[path] = ""
        layout = Layout(topic.type_name, channel=0, strings=strings, lengths=lengths, values=topic.values)
        columns = {path: column for path, column in topic.columns.items() if path in (layout.dtype.names or ())}
        fields = [_Field(*place_of(layout, path), value_of(kind, column)) for path, column in columns.items()]
        self._template = padded(layout.records(1).tobytes()[MESSAGE_PREFIX.size :], pad_to)
        self._groups = _grouped(fields)
        self._stamp = struct.Struct("<iI").pack_into
        self._stamp_offset = place_of(layout, f"{topic.header}.stamp.sec")[0]

    def encode(self, sample: Any, stamp_ns: int) -> bytearray:
        """Return the message of a sample."""
        data = bytearray(self._template)
        self._stamp(data, self._stamp_offset, *divmod(stamp_ns, NS_PER_S))
        for pack, offset, values in self._groups:
            numbers: list[Any] = []
            for is_vector, value in values:
                if is_vector:
                    numbers += value(sample)
                else:
                    numbers.append(value(sample))
            pack(data, offset, *numbers)
        return data
