"""run.mcap of a data set: after each batch's part of the flight stands the chunk with the batch's frames.

Written from the front to the back under a temporary name. What is there from an earlier attempt is written over with
the same bytes, but for chunks of frames that were found whole, which are passed over.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema

from hil.dataset.flight import FlightPart
from hil.dataset.journal import StoredChunk
from hil.dataset.tree import PART, RECORDING, unwritable
from hil.recorder.cdr import schema_text
from hil.recorder.frame_description import FrameDescription
from hil.recorder.frame_series import FrameSeries
from hil.recorder.mcap_file import Block, ChunkFacts, McapFile, SafeFile, pack_chunk
from hil.recorder.mcap_sink import EventSeries, TopicWriters
from hil.recorder.ros2_messages import DEFINITIONS
from hil.recorder.topics import SAMPLE_TOPICS, TRUTH_TOPICS
from hil.signals.errors import RecordingError
from hil.signals.samples import CHANNEL_UNITS, RADAR_UNITS, FrameSample, ImageSample

Declared = tuple[int, str, str]  # number, topic, type

_FIRST_CHANNEL = 256  # those of the flight are below
_TOPICS = ("tf_static", "", "pose", "camera_info", *CHANNEL_UNITS, *RADAR_UNITS)
_ROOM = 32  # channels of a sensor
_FIRST_SCHEMA = 256
_SCHEMAS = {name: _FIRST_SCHEMA + i for i, name in enumerate(sorted(DEFINITIONS))}
assert len(_TOPICS) <= _ROOM


class ChannelBook(McapFile):
    """Numbers of channels, as a writer of series asks for them."""

    def __init__(self, sensor: str, number: int) -> None:
        self._sensor, self._first = sensor, _FIRST_CHANNEL + _ROOM * number
        self.declared: dict[int, Declared] = {}

    def channel(self, topic: str, type_name: str, schema_text: str) -> int:  # noqa: ARG002
        name = topic.removeprefix("/").removeprefix(self._sensor).removeprefix("/")
        number = self._first + _TOPICS.index(name)
        self.declared[number] = (number, topic, type_name)
        return number


class EncodedFrames(FrameSeries):
    """Frames of one sensor whose pictures were encoded before."""

    def __init__(self, port: str, description: FrameDescription, number: int) -> None:
        super().__init__(port, description)
        self.book = ChannelBook(port, number)
        self.with_place = False  # whether the next block says where the sensor sits
        self._png: dict[int, Mapping[str, bytes]] = {}

    def add_encoded(self, sample: FrameSample, png: Mapping[str, bytes]) -> None:
        """`png`: by channel, those that have one."""
        self._png[sample.seq] = png
        self.add(sample, sample.t_capture_ns)

    def take_blocks(self) -> list[Block]:
        blocks = [block for block in self.blocks(self.book) if len(block.log_ns)]
        self._png.clear()
        return blocks

    def _place(self, file: McapFile, sample: FrameSample, log_ns: int) -> None:
        if self.with_place:
            self.with_place = False
            super()._place(file, sample, log_ns)

    def _picture(self, file: McapFile, sample: ImageSample, log_ns: int) -> None:
        png = self._png[sample.seq]
        rest = {name: picture for name, picture in sample.channels.items() if name not in png}
        super()._picture(file, sample._replace(channels=rest), log_ns)
        for name in sorted(png):
            topic = self._topic(
                file,
                name,
                "sensor_msgs/CompressedImage",
                strings={"header.frame_id": self._description.frame_id, "format": "png"},
                blob=1,
            )
            topic.add(sample, log_ns, {}, png[name])


def pack_frames(series: list[EncodedFrames]) -> tuple[bytes, ChunkFacts, tuple[Declared, ...]]:
    """The chunk, what the summary says of it, and the channels in it."""
    blocks = [block for one in series for block in one.take_blocks()]
    known = {number: declared for one in series for number, declared in one.book.declared.items()}
    declared = tuple(known[block.channel] for block in blocks)
    news = RecordBuilder()
    schemas: set[int] = set()
    for schema, channel in map(records_of, declared):
        if schema.id not in schemas:
            schemas.add(schema.id)
            schema.write(news)
        channel.write(news)
    return *pack_chunk(blocks, news.end()), declared


@cache
def records_of(declared: Declared) -> tuple[Schema, Channel]:
    """The declarations of a channel as MCAP has them."""
    number, topic, type_name = declared
    schema = Schema(
        id=_SCHEMAS[type_name],
        name=type_name.replace("/", "/msg/"),
        encoding="ros2msg",
        data=schema_text(type_name).encode(),
    )
    return schema, Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=schema.id)


def part_path(root: Path) -> Path:
    """Where the recording is until it is finished."""
    return root / f"{RECORDING}{PART}"


class DatasetRecording:
    """Raises RecordingError from any method where the file cannot be written."""

    def __init__(
        self, root: Path, *, tick_ns: int, metadata: Mapping[str, str], attachments: Mapping[str, bytes]
    ) -> None:
        self._root = root
        self._path = part_path(root)
        final = root / RECORDING
        if final.exists() and not self._path.exists():
            os.rename(final, self._path)
        self._safe = SafeFile(self._path, _open_kept)
        self._mcap = McapFile(self._safe)
        self._tick_ns = tick_ns
        self._truth = TopicWriters(TRUTH_TOPICS, "")
        self._samples: dict[str, TopicWriters] = {}
        self._events = EventSeries(self._mcap)
        self._mcap.metadata("hil_dataset", dict(metadata), 0)
        for name, data in attachments.items():
            self._mcap.attach(name, "text/yaml" if name.endswith(".yaml") else "text/plain", data, 0)

    def add_flight(self, part: FlightPart) -> None:
        """What the flight gave during a batch."""
        blocks = self._truth.blocks(self._mcap, self._tick_ns, part.truths, part.truths["stamp_ns"])
        for port, samples in sorted(part.samples.items()):
            writers = self._samples.get(port)
            if writers is None:
                writers = self._samples[port] = TopicWriters(SAMPLE_TOPICS[samples.kind], port)
            blocks += writers.blocks(self._mcap, self._tick_ns, samples.columns, samples.released_ns)
        for t_ns, what, text in part.events:
            self._events.add(t_ns, what, text)
        blocks.append(self._events.waiting.block())
        self._mcap.chunk(blocks, 0)

    @property
    def size(self) -> int:
        """Bytes so far: where the next chunk will stand."""
        return self._safe.size

    def add_frames(self, chunk: StoredChunk, data: bytes | None) -> None:
        """The chunk of a batch: `data`, or, None, what already stands there."""
        start = self._safe.size
        if data is not None:
            try:
                self._safe.write(data, 0)
            except RecordingError as error:
                raise unwritable(self._path, error.__cause__ or error) from error
        else:
            self._safe.skip(chunk.size)
        for declared in chunk.channels:
            self._mcap.know(*records_of(declared))
        self._mcap.adopt(chunk.facts, start)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write the summary and give the file its name."""
        self._mcap.metadata("hil_result", dict(metadata), 0)
        self._mcap.finish(0)
        self._safe.cut()
        self.close()
        try:
            os.rename(self._path, self._root / RECORDING)
        except OSError as error:
            raise unwritable(self._path, error) from error

    def close(self) -> None:
        """Idempotent."""
        self._safe.close()


def _open_kept(path: Path) -> BinaryIO:
    """For writing from the front, with what is there kept."""
    return open(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), "r+b", buffering=0)
