"""Reading a recording back, whole or cut off at any byte.

Only whole records count: a file whose writer was killed gives everything up to its last whole chunk. What is
wrong inside a whole record (a bad checksum, another program's file) is a `RecordingError`.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema

from hil.recorder.cdr import MESSAGE_PREFIX, decode
from hil.recorder.mcap_file import MAGIC
from hil.signals.errors import RecordingError

_HEAD = struct.Struct("<BQ")
_CHUNK_TIMES = struct.Struct("<QQ")  # a chunk begins with the log times of its first and last message

# Within one tick: the order in which things happen, so that the first difference is the cause of those after it.
_PHASES = ("/truth/", "/tf", "", "/mavlink/to_autopilot", "/mavlink/from_autopilot", "/actuators", "/events")


class RecordedMessage(NamedTuple):
    """One message. `data` is CDR of the ROS 2 type `type_name` ("package/Name")."""

    topic: str
    type_name: str
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes

    def decode(self) -> dict[str, Any]:
        """Values by dotted path. Only for types this project writes."""
        return decode(self.type_name, self.data)


class RecordedChunk(NamedTuple):
    """One chunk: the log time of its first and last message, and its records as stored."""

    first_ns: int
    last_ns: int
    records: bytes


class Recording:
    """A recording opened for reading.

    After `scan` or a whole pass over `chunks`: `metadata` and `attachments` by name, `last_ns` the log time of the
    last readable message, `complete` whether the writer finished the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.complete = False
        self.last_ns = 0
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}
        try:
            with open(path, "rb") as file:
                magic = file.read(len(MAGIC))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
        if magic != MAGIC:
            raise RecordingError(f"{path}: not an MCAP recording")

    def scan(self) -> Recording:
        """Read everything but the messages. Returns itself."""
        for _ in self._chunk_bodies(_CHUNK_TIMES.size):
            pass
        return self

    def chunks(self) -> Iterator[RecordedChunk]:
        """Every whole chunk in file order."""
        for body in self._chunk_bodies(None):
            yield self._chunk(Chunk.read(ReadDataStream(BytesIO(body))))

    def _chunk_bodies(self, wanted: int | None) -> Iterator[bytes]:
        """The first `wanted` bytes (None: all) of every whole chunk; takes in the other records on the way."""
        self.complete = False
        with open(self.path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            at = len(MAGIC)
            while at + _HEAD.size <= size:
                file.seek(at)
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                at += _HEAD.size + length
                if at > size:
                    return
                if opcode == Opcode.CHUNK:
                    body = file.read(length if wanted is None else wanted)
                    self.last_ns = max(self.last_ns, _CHUNK_TIMES.unpack_from(body)[1])
                    yield body
                elif opcode == Opcode.METADATA:
                    metadata = Metadata.read(ReadDataStream(BytesIO(file.read(length))))
                    self.metadata[metadata.name] = metadata.metadata
                elif opcode == Opcode.ATTACHMENT:
                    attachment = Attachment.read(ReadDataStream(BytesIO(file.read(length))))
                    self.attachments[attachment.name] = attachment.data
                elif opcode == Opcode.FOOTER:
                    file.seek(at)
                    self.complete = file.read(len(MAGIC)) == MAGIC
                    return

    def _chunk(self, chunk: Chunk) -> RecordedChunk:
        try:
            records = (
                zstandard.decompress(chunk.data, chunk.uncompressed_size) if chunk.compression == "zstd" else chunk.data
            )
        except zstandard.ZstdError as error:
            raise RecordingError(f"{self.path}: a chunk cannot be unpacked ({error})") from error
        if chunk.compression not in ("zstd", ""):
            raise RecordingError(f"{self.path}: compression {chunk.compression!r} is not one this bench writes")
        if chunk.uncompressed_crc and zlib.crc32(records) != chunk.uncompressed_crc:
            raise RecordingError(f"{self.path}: a chunk's checksum is wrong; the file was changed or damaged")
        return RecordedChunk(chunk.message_start_time, chunk.message_end_time, records)

    def learn(self, chunk: RecordedChunk) -> None:
        """Take in the schemas and channels at the head of a chunk. Needed only where its messages are skipped."""
        records, at = chunk.records, 0
        while at < len(records):
            opcode, length = _HEAD.unpack_from(records, at)
            if opcode == Opcode.MESSAGE:
                return
            body = records[at + _HEAD.size : at + _HEAD.size + length]
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(body)))
                self._schemas[schema.id] = schema.name.replace("/msg/", "/")
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(body)))
                self._channels[channel.id] = (channel.topic, self._schemas[channel.schema_id])
            at += _HEAD.size + length

    def messages_of(self, chunk: RecordedChunk) -> list[RecordedMessage]:
        """The messages of a chunk by time, and within one tick in the order in which they came about."""
        self.learn(chunk)
        found: list[RecordedMessage] = []
        records, at = chunk.records, 0
        while at < len(records):
            opcode, length = _HEAD.unpack_from(records, at)
            end = at + _HEAD.size + length
            if opcode == Opcode.MESSAGE:
                _, _, channel, sequence, log_ns, publish_ns = MESSAGE_PREFIX.unpack_from(records, at)
                topic, type_name = self._channels[channel]
                data = records[at + MESSAGE_PREFIX.size : end]
                found.append(RecordedMessage(topic, type_name, sequence, log_ns, publish_ns, data))
            at = end
        found.sort(key=causal_order)
        return found

    def messages(self) -> Iterator[RecordedMessage]:
        """Every readable message, in order."""
        for chunk in self.chunks():
            yield from self.messages_of(chunk)


def causal_order(message: RecordedMessage) -> tuple[int, int, str, int]:
    """Sort key: time, place in the tick, topic, sequence."""
    topic = message.topic
    phase = 2
    for i, prefix in enumerate(_PHASES):
        if prefix and topic.startswith(prefix):
            phase = i
            break
    return (message.log_time_ns, phase, topic, message.sequence)


def read_messages(path: Path) -> Iterator[RecordedMessage]:
    """Every message of a recording in time order, up to its end or to where it was cut off.

    Raises RecordingError where the file is missing, is no MCAP file, or is damaged inside.
    """
    return Recording(path).messages()
