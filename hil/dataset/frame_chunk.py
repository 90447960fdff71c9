"""What a batch adds to the recording: one chunk with all of its frames, complete in itself.

Pictures are sensor_msgs/CompressedImage with the very bytes of the PNG files; what has no PNG is recorded as in a run.
Numbers of channels and schemas follow from sensor and topic alone, so that chunks made by different workers fit
together, and each chunk brings the declarations of what it uses. It is not compressed: pictures are so already.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema

from hil.recorder.cdr import schema_text
from hil.recorder.frame_description import FrameDescription
from hil.recorder.frame_series import FrameSeries
from hil.recorder.mcap_file import Block, ChunkFacts, McapFile, pack_chunk
from hil.recorder.ros2_messages import DEFINITIONS
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
