"""Reading a recording back, whole or cut off at any byte, by the `mcap` library's reader.

Only whole records count: a file whose writer was killed gives everything up to its last whole chunk. What is
wrong inside a whole record (a bad checksum, another program's file) is a `RecordingError`.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from hil.recorder.cdr import decode
from hil.signals.errors import RecordingError

_DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError)  # what the library raises at bytes that are none

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
                magic = file.read(len(MCAP0_MAGIC))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
        if magic != MCAP0_MAGIC:
            raise RecordingError(f"{path}: not an MCAP recording")

    def scan(self) -> Recording:
        """Read everything but the messages. Returns itself."""
        for _ in self.chunks():
            pass
        return self

    def chunks(self) -> Iterator[Chunk]:
        """Every whole chunk in file order; takes in the other records on the way."""
        self.complete = False
        with open(self.path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            reader = StreamReader(_WholeReads(file), emit_chunks=True, record_size_limit=size)  # type: ignore[arg-type]
            try:
                for record in reader.records:
                    if isinstance(record, Chunk):
                        self.last_ns = max(self.last_ns, record.message_end_time)
                        yield record
                    elif isinstance(record, Metadata):
                        self.metadata[record.name] = record.metadata
                    elif isinstance(record, Attachment):
                        self.attachments[record.name] = record.data
                self.complete = True
            except (EndOfFile, RecordLengthLimitExceeded):
                return  # its writer was killed
            except _DAMAGE as error:
                raise RecordingError(f"{self.path}: the file was changed or damaged ({error})") from error

    def _records(self, chunk: Chunk) -> Iterator[McapRecord]:
        """What is in a chunk, one after the other."""
        if chunk.compression not in ("zstd", "lz4", ""):
            raise RecordingError(f"{self.path}: compression {chunk.compression!r} is not one that can be read here")
        try:
            data, size = get_chunk_data_stream(chunk, validate_crc=True)
            records = StreamReader(data, skip_magic=True).records  # type: ignore[arg-type]
            while data.count < size:
                yield next(records)
        except _DAMAGE as error:
            raise RecordingError(f"{self.path}: a chunk was changed or damaged ({error})") from error

    def learn(self, chunk: Chunk) -> None:
        """Take in the schemas and channels at the head of a chunk. Needed only where its messages are skipped."""
        for record in self._records(chunk):
            if isinstance(record, Message):
                return
            self._declared(record)

    def _declared(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record.name.replace("/msg/", "/")
        elif isinstance(record, Channel):
            self._channels[record.id] = (record.topic, self._schemas[record.schema_id])

    def messages_of(self, chunk: Chunk) -> list[RecordedMessage]:
        """The messages of a chunk by time, and within one tick in the order in which they came about."""
        found: list[RecordedMessage] = []
        for record in self._records(chunk):
            if isinstance(record, Message):
                topic, type_name = self._channels[record.channel_id]
                times = record.log_time, record.publish_time
                found.append(RecordedMessage(topic, type_name, record.sequence, *times, record.data))
            else:
                self._declared(record)
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


class _WholeReads:
    """A file in which a read that would come back short finds the end: nothing is taken of a record that was cut."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, count: int) -> bytes:
        data = self._file.read(count)
        if len(data) < count:
            raise EndOfFile
        return data
