"""Recording of a data set, run.mcap: for each batch a chunk of flight data, then a chunk of frames.

The file is written from front to back under a temporary name. Complete chunks of frames of an earlier attempt are
skipped; its other data are overwritten with the same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

from isal.isal_zlib import crc32
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema

from hil.apps.dataset.flight import FlightData
from hil.apps.dataset.storage.journal import BatchRecord, StoredChunk
from hil.apps.dataset.storage.tree import INCOMPLETE, TreeWriter, unwritable, writes
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.frame_series import BlobTopic, FrameSeries, add_mount
from hil.run.recorder.mcap.cdr import schema_text
from hil.run.recorder.mcap.mcap_file import Block, ChunkFacts, McapFile, SafeFile, Topics, VehicleTopics, pack_chunk
from hil.run.recorder.mcap.mcap_sink import EventSeries, TopicWriters
from hil.run.recorder.mcap.ros2_messages import DEFINITIONS
from hil.run.recorder.mcap.topics import SAMPLE_TOPICS, TRUTH_TOPICS
from hil.run_files import MCAP_NAME
from signals.errors import RecordingError
from signals.samples import CHANNEL_UNITS, RADAR_UNITS, FrameSample, ImageSample

Declaration = tuple[int, str, str]  # number, topic, type

_FIRST_CHANNEL = 256  # flight data use lower numbers
_POSE_TOPICS = [topic for topic in TRUTH_TOPICS if topic.suffix == "truth/pose"]  # of the other vehicles, up to 99
_TOPICS = ("tf_static", "", "pose", "camera_info", *CHANNEL_UNITS, *RADAR_UNITS)
_CHANNELS_PER_SENSOR = 32
_FIRST_SCHEMA = 256
_SCHEMAS = {name: _FIRST_SCHEMA + i for i, name in enumerate(sorted(DEFINITIONS))}
assert len(_TOPICS) <= _CHANNELS_PER_SENSOR


class ChannelRegistry(McapFile):
    """Fixed channel numbers of a sensor's topics, so that workers need not coordinate.

    A `FrameSeries` declares its channels here as if it were the recording's file.
    """

    def __init__(self, sensor: str, number: int) -> None:
        self._sensor, self._first = sensor, _FIRST_CHANNEL + _CHANNELS_PER_SENSOR * number
        self.declared: dict[int, Declaration] = {}

    def channel(self, topic: str, type_name: str, schema_text: str) -> int:  # noqa: ARG002
        """Declare a topic and return its channel number."""
        name = topic.removeprefix("/").removeprefix(self._sensor).removeprefix("/")
        number = self._first + _TOPICS.index(name)
        self.declared[number] = (number, topic, type_name)
        return number


class EncodedFrames(FrameSeries):
    """Recorded frames of one sensor, with pictures that are already encoded."""

    def __init__(self, port: str, description: FrameDescription, number: int) -> None:
        super().__init__(port, description)
        self.channels = ChannelRegistry(port, number)
        self.with_transform = False  # True: the next block declares the sensor's mounting
        self._png: dict[int, Mapping[str, bytes]] = {}

    def add_encoded(self, sample: FrameSample, png: Mapping[str, bytes]) -> None:
        """Add a sample; `png` holds the encoded pictures by channel."""
        self._png[sample.seq] = png
        self.add(sample, sample.t_capture_ns)

    def take_blocks(self) -> list[Block]:
        """Return the blocks of the samples added since the last call."""
        blocks = [block for block in self.blocks(self.channels) if len(block.log_ns)]
        self._png.clear()
        return blocks

    def _add_mount(self, file: Topics, sample: FrameSample, log_ns: int) -> None:
        if self.with_transform:
            self.with_transform = False
            super()._add_mount(file, sample, log_ns)

    def _add_picture(self, file: Topics, sample: ImageSample, log_ns: int) -> None:
        png = self._png[sample.seq]
        not_encoded = {name: picture for name, picture in sample.channels.items() if name not in png}
        super()._add_picture(file, sample._replace(channels=not_encoded), log_ns)
        for name in sorted(png):
            topic = self._topic(
                file,
                name,
                "sensor_msgs/CompressedImage",
                strings={"header.frame_id": self._description.frame_id, "format": "png"},
                item_bytes=1,
            )
            topic.add(sample, log_ns, {}, png[name])


def pack_frames(series: list[EncodedFrames]) -> tuple[bytes, ChunkFacts, tuple[Declaration, ...]]:
    """Return a chunk with the samples of all sensors, its summary entries and its channels."""
    blocks = [block for frames in series for block in frames.take_blocks()]
    by_number = {number: declared for frames in series for number, declared in frames.channels.declared.items()}
    declared = tuple(by_number[block.channel] for block in blocks)
    declarations = RecordBuilder()
    schemas: set[int] = set()
    for schema, channel in map(records_of, declared):
        if schema.id not in schemas:
            schemas.add(schema.id)
            schema.write(declarations)
        channel.write(declarations)
    return *pack_chunk(blocks, declarations.end()), declared


@cache
def records_of(declared: Declaration) -> tuple[Schema, Channel]:
    """Return the MCAP schema and channel records of a declared channel."""
    number, topic, type_name = declared
    schema = Schema(
        id=_SCHEMAS[type_name],
        name=type_name.replace("/", "/msg/"),
        encoding="ros2msg",
        data=schema_text(type_name).encode(),
    )
    return schema, Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=schema.id)


def incomplete_path(root: Path) -> Path:
    """Return the recording's temporary name, used until it is complete."""
    return root / f"{MCAP_NAME}{INCOMPLETE}"


def is_complete(tree: TreeWriter, record: BatchRecord, offset: int) -> bool:
    """Return True if all files of a batch, and its chunk at `offset` of the recording, match their checksums."""
    if not all(tree.holds(file) for file in record.files):
        return False
    try:
        with open(incomplete_path(tree.root), "rb", buffering=0) as file:
            data = os.pread(file.fileno(), record.chunk.size, offset)
    except OSError:
        return False
    return len(data) == record.chunk.size and crc32(data) == record.chunk.crc32


class Stamp(NamedTuple):
    """Times of a message that stands for no sample of its own."""

    seq: int
    t_capture_ns: int
    t_available_ns: int


class DatasetRecording:
    """Writer of run.mcap. Every method raises RecordingError if the file cannot be written."""

    def __init__(
        self,
        root: Path,
        *,
        tick_ns: int,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
        mounts: Mapping[str, FrameDescription],
    ) -> None:
        """`mounts`: descriptions of the flight sensors that have one."""
        self._mounts = mounts
        self._root = root
        self._path = incomplete_path(root)
        final = root / MCAP_NAME
        if final.exists() and not self._path.exists():
            os.rename(final, self._path)
        self._safe = SafeFile(self._path, _open_without_truncating)
        self._mcap = McapFile(self._safe)
        self._tick_ns = tick_ns
        self._truth = TopicWriters(TRUTH_TOPICS, "")
        self._other_poses: dict[str, TopicWriters] = {}
        self._samples: dict[str, TopicWriters] = {}
        self._events = EventSeries(self._mcap)
        self._mcap.metadata("hil_dataset", dict(metadata), 0)
        for name, data in attachments.items():
            self._mcap.attach(name, "text/yaml" if name.endswith(".yaml") else "text/plain", data, 0)

    def add_flight(self, data: FlightData) -> None:
        """Append a chunk with the flight data of a batch."""
        blocks = self._truth.blocks(self._mcap, self._tick_ns, data.truths, data.truths["stamp_ns"])
        for name, truths in data.others.items():
            poses = self._other_poses.setdefault(name, TopicWriters(_POSE_TOPICS, ""))
            blocks += poses.blocks(VehicleTopics(self._mcap, name), self._tick_ns, truths, truths["stamp_ns"])
        for port, samples in sorted(data.samples.items()):
            writers = self._samples.get(port)
            if writers is None:
                writers = self._samples[port] = TopicWriters(SAMPLE_TOPICS[samples.kind], port)
                if port in self._mounts:
                    blocks.append(self._mount(self._mounts[port], int(samples.released_ns[0])))
            blocks += writers.blocks(self._mcap, self._tick_ns, samples.columns, samples.released_ns)
        for t_ns, kind, text in data.events:
            self._events.add(t_ns, kind, text)
        blocks.append(self._events.pending.block())
        self._mcap.chunk(blocks, 0)

    def _mount(self, description: FrameDescription, t_ns: int) -> Block:
        return add_mount(BlobTopic, self._mcap, description, Stamp(0, t_ns, t_ns), t_ns).pending.block()

    @property
    def size(self) -> int:
        """Bytes written so far, the offset of the next chunk."""
        return self._safe.size

    def add_frames(self, chunk: StoredChunk, data: bytes | None) -> None:
        """Append a batch's chunk of frames. If `data` is None the file already holds the chunk, and it is skipped."""
        start = self._safe.size
        if data is not None:
            try:
                self._safe.write(data, 0)
            except RecordingError as error:
                raise unwritable(self._path, error.__cause__ or error) from error
        else:
            self._safe.skip(chunk.size)
        for declared in chunk.channels:
            self._mcap.declare(*records_of(declared))
        self._mcap.adopt(chunk.facts, start)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write the summary and rename the file to run.mcap."""
        self._mcap.metadata("hil_result", dict(metadata), 0)
        self._mcap.finish(0)
        self._safe.truncate()
        self.close()
        with writes(self._path):
            os.rename(self._path, self._root / MCAP_NAME)

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._safe.close()


def _open_without_truncating(path: Path) -> BinaryIO:
    """Open for writing from the front without truncating."""
    return open(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), "r+b", buffering=0)
