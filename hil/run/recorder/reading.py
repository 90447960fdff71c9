"""Reader of recordings, complete or cut off at any byte, based on the reader of the `mcap` library.

Only complete records count: a file whose writer was killed yields everything up to its last complete chunk. An error
inside a complete record (a wrong checksum, a file of another program) is a `RecordingError`.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from hil.run.recorder.mcap.cdr import decode
from signals.errors import RecordingError, file_errors

# Raised by the libraries for damaged bytes.
DAMAGE_ERRORS = (
    McapError, ValueError, LookupError, OverflowError, MemoryError, RuntimeError, struct.error, zstandard.ZstdError
)  # fmt: skip

# Order of the topics within one tick, from cause to effect, so that the first difference is the cause of later ones.
_PHASES = ("/truth/", "/tf", "", "/mavlink/to_autopilot", "/mavlink/from_autopilot", "/actuators", "/events")


class RecordedMessage(NamedTuple):
    """One message. `data` is the CDR encoding of the ROS 2 type `type_name` ("package/Name")."""

    topic: str
    type_name: str
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes

    def decode(self) -> dict[str, Any]:
        """Return the values by dotted path. Raises RecordingError for bytes that are not a message of this project."""
        try:
            return decode(self.type_name, self.data)
        except DAMAGE_ERRORS as error:
            raise RecordingError(f"{self.topic}, message {self.sequence}: damaged ({error!r})") from error


class Recording:
    """A recording opened for reading.

    After `scan` or a full pass over `chunks`: `metadata` and `attachments` by name, `last_ns` is the log time of the
    last readable message, `complete` is True if the writer finished the file.
    """

    def __init__(self, path: Path, vehicle: str = "") -> None:
        """`vehicle`: read only the messages of this one of several, with topics as if it had flown alone."""
        self.path, self.vehicle = path, vehicle
        self.complete = False
        self.last_ns = 0
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}
        with file_errors(path, "cannot be read"), open(path, "rb") as file:
            magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            raise RecordingError(f"{path}: not an MCAP recording")

    @property
    def vehicles(self) -> list[str]:
        """Names of the vehicles after `scan`; empty for a run of one."""
        return self.metadata.get("hil_run", {}).get("vehicles", "").split()

    def scan(self) -> Recording:
        """Read everything except the messages. Returns itself."""
        for _ in self.chunks():
            pass
        return self

    def chunks(self) -> Iterator[Chunk]:
        """Yield every complete chunk in file order; stores the other records on the way."""
        self.complete = False
        with open(self.path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            reader = StreamReader(_CompleteReads(file), emit_chunks=True, record_size_limit=size)  # type: ignore[arg-type]
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
                return  # the writer was killed
            except DAMAGE_ERRORS as error:
                raise RecordingError(f"{self.path}: the file is damaged ({error})") from error

    def _records(self, chunk: Chunk) -> Iterator[McapRecord]:
        """Yield the records of a chunk."""
        if chunk.compression not in ("zstd", "lz4", ""):
            raise RecordingError(
                f"{self.path}: unsupported compression {chunk.compression!r} (supported: zstd, lz4, none)"
            )
        try:
            data, size = get_chunk_data_stream(chunk, validate_crc=True)
            records = StreamReader(data, skip_magic=True).records  # type: ignore[arg-type]
            while data.count < size:
                yield next(records)
        except DAMAGE_ERRORS as error:
            raise RecordingError(f"{self.path}: a chunk is damaged ({error})") from error

    def read_declarations(self, chunk: Chunk) -> None:
        """Store the schemas and channels at the head of a chunk. Needed only for a chunk whose messages are skipped."""
        for record in self._records(chunk):
            if isinstance(record, Message):
                return
            self._store_declaration(record)

    def _store_declaration(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record.name.replace("/msg/", "/")
        elif isinstance(record, Channel):
            if record.schema_id not in self._schemas:
                raise RecordingError(f"{self.path}: damaged: {record.topic} has no schema")
            topic = record.topic
            if self.vehicle:
                topic = topic.removeprefix(f"/{self.vehicle}") if topic.startswith(f"/{self.vehicle}/") else ""
            self._channels[record.id] = (topic, self._schemas[record.schema_id])

    def messages_of(self, chunk: Chunk) -> list[RecordedMessage]:
        """Return the messages of a chunk ordered by time, and within one tick by cause and effect."""
        messages: list[RecordedMessage] = []
        for record in self._records(chunk):
            if isinstance(record, Message):
                if record.channel_id not in self._channels:
                    raise RecordingError(f"{self.path}: damaged: a message of an unknown channel {record.channel_id}")
                topic, type_name = self._channels[record.channel_id]
                times = record.log_time, record.publish_time
                if topic:
                    messages.append(RecordedMessage(topic, type_name, record.sequence, *times, record.data))
            else:
                self._store_declaration(record)
        messages.sort(key=causal_order)
        return messages

    def end_ns(self, topic: str) -> int:
        """Return the log time of the last readable message; of several vehicles, of that of this topic.

        Call it after `scan`. The vehicles of a recording that was cut off end at different times.
        """
        name = topic.split("/")[1]
        if name not in self.vehicles:
            return self.last_ns
        return self._ends_ns.get(name, -1)

    @cached_property
    def _ends_ns(self) -> dict[str, int]:
        """Log time of the last readable message by the first word of its topic, of all vehicles in one pass."""
        ends_ns: dict[str, int] = {}
        for message in self.messages():
            name = message.topic[1:].partition("/")[0]
            ends_ns[name] = max(ends_ns.get(name, -1), message.log_time_ns)
        return ends_ns

    @property
    def whole_ns(self) -> int:
        """Log time up to which the messages of all vehicles are readable, after `scan`."""
        ends = () if self.complete else (self.end_ns(f"/{name}/") for name in self.vehicles)
        return min(ends, default=self.last_ns)

    def messages(self) -> Iterator[RecordedMessage]:
        """Yield every readable message, in order."""
        for chunk in self.chunks():
            yield from self.messages_of(chunk)


def causal_order(message: RecordedMessage) -> tuple[int, int, str, int]:
    """Return the sort key of a message: time, phase of the tick, topic, sequence."""
    return (message.log_time_ns, _phase(message.topic), message.topic, message.sequence)


@lru_cache(maxsize=4096)
def _phase(topic: str) -> int:
    """Return the number of a topic's phase; the name of a vehicle may stand before the topic."""
    of_vehicle = topic[topic.find("/", 1) :]
    for i, prefix in enumerate(_PHASES):
        if prefix and (topic.startswith(prefix) or of_vehicle.startswith(prefix)):
            return i
    return 2


def read_messages(path: Path) -> Iterator[RecordedMessage]:
    """Return every message of a recording in time order, up to its end or to the point where it was cut off.

    Raises RecordingError if the file is missing, is not an MCAP file, or is damaged.
    """
    return Recording(path).messages()


class _CompleteReads:
    """A file that raises EndOfFile instead of a short read, so that no part of a truncated record is used."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, count: int) -> bytes:
        data = self._file.read(count)
        if len(data) < count:
            raise EndOfFile
        return data
