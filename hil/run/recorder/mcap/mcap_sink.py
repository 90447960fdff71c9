"""The MCAP recording: all data of a run as ROS 2 messages that Foxglove and `ros2 bag` open.

During a tick the sink only keeps references to the immutable samples. About once per simulated second it encodes them
column by column and writes one chunk with complete ticks. The messages of a topic are contiguous within a chunk;
readers sort them by time with the message index.

Times of a message: log time = simulated time of the tick that released it; publish time = when the sample became
available; header.stamp = when it was captured. `sequence` is the number of the sample, the tick for truth and
actuators, a running count for MAVLink and events.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.codecs.mavlink_frame import Frame
from hil.run.recorder.detection_series import DetectionSeries
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.frame_series import BlobTopic, FrameSeries, add_mount
from hil.run.recorder.mcap.cdr import Layout, schema_text
from hil.run.recorder.mcap.mcap_file import Block, McapFile, PendingRecords, SafeFile, Topics
from hil.run.recorder.mcap.topics import (
    ACTUATOR_TOPICS,
    SAMPLE_TOPICS,
    TRUTH_TOPICS,
    Columns,
    Topic,
    columns_of,
    with_variances,
)
from signals.detections import Detections
from signals.errors import RecordingError
from signals.samples import FRAME_SAMPLES, ActuatorFrame, Sample, TruthState
from signals.time import NS_PER_S

_LEVELS = {"debug": 10, "warning": 30, "error": 40}
_INFO = 20


class TopicWriter:
    """Encodes columns of one type of sample as the message records of one topic."""

    def __init__(self, file: Topics, topic: Topic, port: str, columns: Columns, tick_ns: int) -> None:
        self._topic = topic
        self.channel = file.channel(f"/{port}{topic.suffix}", topic.type_name, schema_text(topic.type_name))
        strings = {f"{topic.header}.frame_id": file.frame(topic.frame or port)}
        lengths = {path: columns[column].shape[1] for path, column in topic.lengths.items()}
        if topic.child_frame:
            prefix = topic.header.removesuffix("header")
            strings[f"{prefix}child_frame_id"] = file.frame(topic.child_frame)
            lengths[prefix.removesuffix("[0].")] = 1
        self._layout = Layout(
            topic.type_name, channel=self.channel, strings=strings, lengths=lengths, values=topic.values
        )
        self._every = max(1, round(topic.every_s * NS_PER_S / tick_ns)) if topic.every_s else 1

    def block(self, columns: Columns, log_ns: NDArray[np.uint64]) -> Block:
        """Return the records of all rows; of every k-th row for a decimated topic."""
        if self._every > 1:
            selected = columns["tick"] % self._every == 0
            columns = {name: column[selected] for name, column in columns.items()}
            log_ns = log_ns[selected]
        topic = self._topic
        records = self._layout.records(len(log_ns))
        records["$sequence"] = columns["seq"]
        records["$log"] = log_ns
        records["$publish"] = columns["available_ns"]
        records[f"{topic.header}.stamp.sec"] = columns["stamp_s"]
        records[f"{topic.header}.stamp.nanosec"] = columns["stamp_rest_ns"]
        for path, column in topic.columns.items():
            records[path] = columns[column]
        size = self._layout.size
        offsets = np.arange(0, size * len(log_ns), size, dtype=np.uint64)
        return Block(self.channel, (records.tobytes(),), log_ns, offsets)


class TopicWriters:
    """The topics of one port. The first samples declare them and fix the array lengths."""

    def __init__(self, topics: Sequence[Topic], port: str) -> None:
        self._topics = topics
        self._port = port
        self._writers: list[TopicWriter] = []

    def blocks(self, file: Topics, tick_ns: int, columns: Columns, log_ns: NDArray[np.int64]) -> list[Block]:
        """Return the records of samples in the form that `columns_of` returns."""
        if not self._writers:
            topics = [topic for topic in self._topics if not topic.needs or columns[topic.needs].size]
            self._writers = [TopicWriter(file, topic, self._port, columns, tick_ns) for topic in topics]
        unsigned_ns = log_ns.astype(np.uint64)
        return [writer.block(columns, unsigned_ns) for writer in self._writers]


class Series:
    """Collects the samples of one port between two chunks."""

    def __init__(self, kind: type, topics: Sequence[Topic], port: str) -> None:
        self.rows: list[Any] = []
        self.log_ns: list[int] = []
        self._kind = kind
        self._writers = TopicWriters(topics, port)

    def blocks(self, file: Topics, tick_ns: int) -> list[Block]:
        """Return the records of all samples added since the last call."""
        if not self.rows:
            return []
        columns = columns_of(self._kind, self.rows)
        log_ns = np.array(self.log_ns) if self.log_ns else columns["stamp_ns"]
        self.rows.clear()
        self.log_ns.clear()
        return self._writers.blocks(file, tick_ns, columns, log_ns)


class MavlinkSeries:
    """Collects the MAVLink frames of one direction between two chunks."""

    def __init__(self, file: Topics, topic: str) -> None:
        type_name = "hil_msgs/MavlinkFrame"
        self._channel = file.channel(topic, type_name, schema_text(type_name))
        self._layout = Layout(type_name, channel=self._channel, lengths={"data": 0})  # the data follow
        self._count = 0
        self.frames: list[tuple[int, int, bytes]] = []  # time [ns], message id and bytes, since the last chunk

    def block(self) -> Block:
        """Return the records of all frames added since the last call."""
        n = len(self.frames)
        if not n:
            return Block(self._channel, (), np.empty(0, np.uint64), np.empty(0, np.uint64))
        times_ns, msgids, data = zip(*self.frames, strict=True)
        log_ns, sizes = np.array(times_ns), np.array([*map(len, data)])
        heads = self._layout.records(n)
        heads["$length"] += sizes.astype(np.uint64)
        heads["$sequence"] = np.arange(self._count, self._count + n) & 0xFFFFFFFF
        heads["$log"] = heads["$publish"] = log_ns
        heads["stamp.sec"], heads["stamp.nanosec"] = np.divmod(log_ns, NS_PER_S)
        heads["msgid"], heads["data$length"] = msgids, sizes
        self._count += n
        self.frames.clear()
        parts = chain.from_iterable(zip(heads.view(f"V{heads.itemsize}").tolist(), data, strict=True))
        ends = np.cumsum(sizes + heads.itemsize, dtype=np.uint64)
        offsets = np.concatenate([np.zeros(1, np.uint64), ends[:-1]])
        return Block(self._channel, tuple(parts), log_ns.astype(np.uint64), offsets)


class EventSeries:
    """Events of the bench (phases, status texts, faults) as rcl_interfaces/Log."""

    def __init__(self, file: Topics) -> None:
        self.pending = PendingRecords(file.channel("/events", "rcl_interfaces/Log", schema_text("rcl_interfaces/Log")))
        self._count = 0

    def add(self, t_ns: int, kind: str, text: str) -> None:
        """Add one event."""
        layout = Layout(
            "rcl_interfaces/Log",
            channel=self.pending.channel,
            strings={"name": kind, "msg": text, "file": "", "function": ""},
        )
        record = layout.records(1)
        record["$sequence"], record["$log"], record["$publish"] = self._count, t_ns, t_ns
        record["stamp.sec"], record["stamp.nanosec"] = divmod(t_ns, NS_PER_S)
        record["level"] = _LEVELS.get(kind, _INFO)
        self._count += 1
        self.pending.add(t_ns, record.tobytes())


class McapRecording:
    """The file `run.mcap`, which the vehicles of a run share."""

    def __init__(
        self, file: SafeFile, *, tick_ns: int, metadata: Mapping[str, str], attachments: Mapping[str, bytes]
    ) -> None:
        self._file = file
        self.mcap = McapFile(file)
        self.mcap.metadata("hil_run", {"tick_ns": str(tick_ns), **metadata}, 0)
        for name, data in attachments.items():
            self.mcap.attach(name, "text/yaml" if name.endswith(".yaml") else "text/plain", data, 0)

    def close(self, tick: int, result: Mapping[str, str]) -> None:
        """Write `result` as metadata and the summary; close the file in any case."""
        try:
            self.mcap.metadata("hil_result", dict(result), tick)
            self.mcap.finish(tick)
        finally:
            self._file.close()


class McapSink:
    """Writes one vehicle's data to `run.mcap`. The methods are those of `hil.run.recorder.recorder.Recorder`."""

    def __init__(self, mcap: Topics, *, tick_ns: int) -> None:
        self._mcap = mcap
        self._tick_ns = tick_ns
        self._now_ns = 0
        self._truth = Series(TruthState, TRUTH_TOPICS, "")
        self._actuators = Series(ActuatorFrame, ACTUATOR_TOPICS, "")
        self._samples: dict[str, Series] = {}
        self._frames: dict[str, FrameSeries] = {}
        self._mounts: list[BlobTopic] = []  # of sensors with a frame of their own but no pictures or points
        self._descriptions: dict[str, FrameDescription] = {}
        self._deviations: dict[str, Mapping[str, float]] = {}
        self._sent = MavlinkSeries(self._mcap, "/mavlink/to_autopilot")
        self._received = MavlinkSeries(self._mcap, "/mavlink/from_autopilot")
        self._events = EventSeries(self._mcap)
        self._detections: dict[str, DetectionSeries] = {}

    def holds(self, frames: int, picture_bytes: int) -> bool:
        """Return True if it holds more MAVLink frames than this, or more bytes of pictures and point clouds."""
        if len(self._sent.frames) + len(self._received.frames) > frames:
            return True
        return bool(self._frames) and self.pending_bytes > picture_bytes

    @property
    def pending_bytes(self) -> int:
        """Size of the pictures and point clouds since the last flush."""
        return sum(series.pending_bytes for series in self._frames.values())

    def describe(self, port: str, description: FrameDescription) -> None:
        """Describe the sensor of `port`, before its first sample."""
        self._descriptions[port] = description

    def describe_noise(self, port: str, deviations: Mapping[str, float]) -> None:
        """Describe the noise of the samples of `port` by field, 1 sigma, before its first sample."""
        self._deviations[port] = deviations

    def truth(self, truth: TruthState) -> None:
        """Begin a tick."""
        self._now_ns = truth.t_ns
        self._truth.rows.append(truth)

    def sample(self, port: str, sample: Sample) -> None:
        """Record a sample released on `port`."""
        series = self._samples.get(port)
        if series is None:
            if isinstance(sample, FRAME_SAMPLES):
                frames = self._frames.get(port)
                if frames is None:
                    frames = self._frames[port] = FrameSeries(port, self._descriptions.get(port))
                frames.add(sample, self._now_ns)
                return
            topics = SAMPLE_TOPICS.get(type(sample))
            if topics is None:
                known = ", ".join(kind.__name__ for kind in SAMPLE_TOPICS)
                raise RecordingError(
                    f"port {port}: a {type(sample).__name__} has no recorded form (supported: {known}). "
                    "Add its topics to SAMPLE_TOPICS in hil/run/recorder/mcap/topics.py"
                )
            series = self._samples[port] = Series(
                type(sample), with_variances(topics, self._deviations.get(port, {})), port
            )
            if port in self._descriptions:
                self._mounts.append(add_mount(BlobTopic, self._mcap, self._descriptions[port], sample, self._now_ns))
        series.rows.append(sample)
        series.log_ns.append(self._now_ns)

    def sent(self, t_ns: int, pieces: Iterable[tuple[int, bytes]]) -> None:
        """Record the frames sent in a tick, as returned by `split_frames`."""
        for msgid, raw in pieces:
            self._sent.frames.append((t_ns, msgid, raw))

    def received(self, t_ns: int, frames: Iterable[Frame]) -> None:
        """Record the frames received in a tick."""
        for frame in frames:
            self._received.frames.append((t_ns, frame.msgid, frame.raw))

    def actuators(self, frame: ActuatorFrame) -> None:
        """Record the command latched in a tick."""
        self._actuators.rows.append(frame)

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Record an event. Its level is the kind if that is "debug", "warning" or "error", otherwise information."""
        self._events.add(t_ns, kind, text)

    def detected(self, t_ns: int, client: str, detections: Detections) -> None:
        """Record detections of a companion."""
        series = self._detections.get(client)
        if series is None:
            series = self._detections[client] = DetectionSeries(client)
        description = self._descriptions.get(detections.topic.partition("/")[0])
        frame_id = detections.topic if description is None else description.frame_id
        series.add(t_ns, detections, self._mcap.frame(frame_id))

    def flush(self, tick: int) -> None:
        """Write the data since the last flush as one chunk. Raises RecordingError at the first failure only."""
        blocks = self._truth.blocks(self._mcap, self._tick_ns)
        for series in self._samples.values():
            blocks += series.blocks(self._mcap, self._tick_ns)
        for frames in self._frames.values():
            blocks += frames.blocks(self._mcap)
        blocks += [mount.pending.block() for mount in self._mounts]
        blocks += [self._sent.block(), self._received.block()]
        blocks += self._actuators.blocks(self._mcap, self._tick_ns)
        for detections in self._detections.values():
            blocks += detections.blocks(self._mcap)
        blocks.append(self._events.pending.block())
        self._mcap.chunk(blocks, tick)

    def close(self, tick: int) -> None:
        """Write the remaining data; the recording is closed by its owner."""
        self.flush(tick)
