"""The measurements of one vehicle on their way to Foxglove.

In each tick the feed keeps references to the tick's immutable samples. About twenty times a second of wall clock the
server takes them, and a thread of its own encodes what clients have subscribed to: of cameras, LiDARs and radars the
newest frame, of everything else all samples, or every k-th tick in a run much faster than real time. Colour pictures
are also offered as JPEG, in `/CAMERA/rgb/compressed`: a raw one of 640 x 480 pixels is 18 MB/s at 20 updates.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

from firmware_bridge.codecs.mavlink_frame import Frame
from hil.run.live.messages import CLOCK, LiveMessages, Names, live_topics
from hil.run.part import RunContext
from hil.run.parts.links.foxglove.server import LiveServer
from hil.run.recorder.detection_series import DetectionSeries
from hil.run.recorder.mcap.cdr import BlobEncoder
from hil.run.recorder.mcap.mcap_file import COMMON_TOPICS
from hil.run.recorder.mcap.mcap_sink import EventSeries, MavlinkSeries
from signals.detections import Detections
from signals.samples import FRAME_SAMPLES, ActuatorFrame, ImageSample, Sample, TruthState
from sim.physics.battery import BatteryState
from sim.sensors.catalog import KINDS

COMPRESSED = "/compressed"
_COLOUR = "rgb"
_MAX_TICKS = 1024  # that wait for the encoding thread; older ones are dropped
_SENT_TICKS = 32  # of one update, at most
_MAX_FRAMES = 2000  # MAVLink frames and events of one update, at most
_STRIDES = (1, 2, 5, 10, 20, 40, 80, 160, 320, 640)  # [ticks]; `/tf` of a 250 Hz run has one message in 10
_TO_AUTOPILOT, _FROM_AUTOPILOT = "/mavlink/to_autopilot", "/mavlink/from_autopilot"


class Tick(NamedTuple):
    """One tick: the true state, the samples that are not frames, and the command that moved the vehicle."""

    truth: TruthState
    released: tuple[tuple[str, Sample], ...]
    actuators: ActuatorFrame
    battery: BatteryState | None


class Pending(NamedTuple):
    """Everything that a vehicle has for one update."""

    ticks: Sequence[Tick]
    frames: dict[str, Sample]  # newest by port, since the last update
    events: Sequence[tuple[int, str, str]]
    detections: Sequence[tuple[int, str, Detections]]
    sent: Sequence[tuple[int, int, bytes]]  # MAVLink: time, message, bytes
    received: Sequence[tuple[int, int, bytes]]


class _Selection:
    """The topics that clients have subscribed to."""

    topics: frozenset[str] = frozenset()

    def __contains__(self, topic: object) -> bool:
        return topic in self.topics


class VehicleFeed:
    """Tap of the recorder and exchange of the scheduler. `step` and the tap belong to the run's thread."""

    free_running = False
    _run: RunContext  # from `attach` on
    _messages: LiveMessages  # likewise

    def __init__(self, server: LiveServer, name: str, jpeg_quality: int) -> None:
        """`name`: of the vehicle in a run of several; empty in a run of one."""
        self.watched = False  # a client has subscribed to something
        self._server, self._names, self._quality = server, Names(name), jpeg_quality
        self._ticks: deque[Tick] = deque(maxlen=_MAX_TICKS)
        self._last: Tick | None = None
        self._frames: dict[str, Sample] = {}
        self._newest: dict[str, Sample] = {}
        self._events: deque[tuple[int, str, str]] = deque(maxlen=_MAX_FRAMES)
        self._detections: deque[tuple[int, str, Detections]] = deque(maxlen=_MAX_FRAMES)
        self._sent: deque[tuple[int, int, bytes]] = deque(maxlen=_MAX_FRAMES)
        self._received: deque[tuple[int, int, bytes]] = deque(maxlen=_MAX_FRAMES)
        self._selection = _Selection()
        self._jpeg: dict[str, BlobEncoder] = {}  # by camera
        self._series: dict[str, Any] = {}

    def attach(self, run: RunContext) -> None:
        """Offer the topics of a built run."""
        self._run = run
        server, config, names = self._server, run.bench.config, self._names
        for topic in live_topics(run.bench):
            if topic.name != CLOCK and (not topic.port or topic.port in run.plan.order):
                server.declare(topic.name, topic.type_name)
        for port, sensor in config.sensors.items():
            if KINDS[sensor.kind].sample_type is ImageSample and f"{port}/{_COLOUR}" in run.plan.order:
                server.declare(names.topic(f"/{port}/{_COLOUR}{COMPRESSED}"), "sensor_msgs/CompressedImage")
        self._messages = LiveMessages(
            config.tick_ns,
            descriptions=run.sensors.descriptions,
            deviations=run.sensors.deviations,
            vehicle=config.name,
            selected=self._selection,
        )
        self._series = {
            "events": EventSeries(self),  # type: ignore[arg-type]
            "sent": MavlinkSeries(self, _TO_AUTOPILOT),  # type: ignore[arg-type]
            "received": MavlinkSeries(self, _FROM_AUTOPILOT),  # type: ignore[arg-type]
        }

    # -- methods of `McapFile`, with the vehicle's name ---------------------------------------------------------------

    def frame(self, frame_id: str) -> str:
        """Return the name of a coordinate frame."""
        return self._names.frame(frame_id)

    def channel(self, topic: str, type_name: str, schema_text: str) -> int:
        """Offer a topic and return its number."""
        return self._server.channel(self._names.topic(topic), type_name, schema_text)

    # -- in the run's thread ------------------------------------------------------------------------------------------

    @property
    def newest_truth(self) -> TruthState | None:
        return None if self._last is None else self._last.truth

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:
        """Keep one tick."""
        run = self._run
        rest = []
        for item in released:
            if isinstance(item[1], FRAME_SAMPLES):
                self._newest[item[0]] = self._frames[item[0]] = item[1]
            else:
                rest.append(item)
        self._last = tick = Tick(truth, tuple(rest), run.scheduler.actuators, run.physics.battery)
        if self.watched:
            self._ticks.append(tick)

    def serve(self, limit_s: float) -> None:
        """Do nothing: it is served before a tick."""

    def sample(self, port: str, sample: Sample) -> None:
        """Do nothing: `step` has the samples."""

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Keep an event, also before a client has subscribed."""
        self._events.append((t_ns, kind, text))

    def detected(self, client: str, detections: Detections) -> None:
        """Keep detections of a companion."""
        self._detections.append((self._run.now_ns(), client, detections))

    def sent(self, t_ns: int, pieces: Iterable[tuple[int, bytes]]) -> None:
        """Keep MAVLink frames to the autopilot."""
        if self.watched:
            self._sent += [(t_ns, msgid, raw) for msgid, raw in pieces]

    def received(self, t_ns: int, frames: Iterable[Frame]) -> None:
        """Keep MAVLink frames from the autopilot."""
        if self.watched:
            self._received += [(t_ns, frame.msgid, frame.raw) for frame in frames]

    def take(self, *, repeat: bool) -> Pending:
        """Return what has come since the last call. `repeat`: for a new subscriber, at least the newest of all."""
        ticks, self._ticks = self._ticks, deque(maxlen=_MAX_TICKS)
        frames, self._frames = self._frames, {}
        if repeat:
            frames = dict(self._newest)
            if not ticks and self._last is not None:
                ticks.append(self._last)
        pending = Pending(
            ticks, frames, tuple(self._events), tuple(self._detections), tuple(self._sent), tuple(self._received)
        )
        for queue in (self._events, self._detections, self._sent, self._received):
            queue.clear()
        return pending

    # -- in the thread that encodes ----------------------------------------------------------------------------------

    def publish(self, pending: Pending, wanted: frozenset[str]) -> None:
        """Encode and send what clients have subscribed to."""
        self._selection.topics = wanted
        ticks = _selected(pending.ticks)
        for tick in ticks:
            self._send(tick, tick.released)
        if pending.frames and (ticks or self._last is not None):
            newest = ticks[-1] if ticks else self._last
            assert newest is not None
            self._selection.topics = frozenset(topic for topic in wanted if self._is_of_frames(topic, pending.frames))
            self._send(newest, tuple(pending.frames.items()), latch=COMMON_TOPICS[1])
            for port, sample in pending.frames.items():
                topic = self._names.topic(f"/{port}/{_COLOUR}{COMPRESSED}")
                if topic in wanted and isinstance(sample, ImageSample) and _COLOUR in sample.channels:
                    self._server.log(topic, self._compressed(port, sample), newest.truth.t_ns)
        self._publish_series(pending)

    def _is_of_frames(self, topic: str, frames: Iterable[str]) -> bool:
        return any(f"{topic}/".startswith(self._names.topic(f"/{port}/")) for port in frames)

    def _send(self, tick: Tick, released: Iterable[tuple[str, Sample]], *, latch: str = "") -> None:
        log, t_ns = self._server.log, tick.truth.t_ns
        for message in self._messages.of_tick(tick.truth, released, tick.actuators, tick.battery):
            name, data = message.topic.name, bytes(message.data)
            if name == latch:
                log(name, data, t_ns, latch=str(hash(data[16:])))  # without the stamp
            else:
                log(name, data, t_ns)

    def _compressed(self, port: str, sample: ImageSample) -> bytes:
        encoder = self._jpeg.get(port)
        if encoder is None:
            description = self._run.sensors.descriptions.get(port)
            frame_id = self._names.frame(port if description is None else description.frame_id)
            strings = {"header.frame_id": frame_id, "format": "jpeg"}
            encoder = self._jpeg[port] = BlobEncoder("sensor_msgs/CompressedImage", strings=strings, item_bytes=1)
        picture = cv2.cvtColor(np.ascontiguousarray(sample.channels[_COLOUR]), cv2.COLOR_RGB2BGR)
        _, jpeg = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, self._quality))
        return encoder.encode(sample, {}, jpeg.tobytes())

    def _publish_series(self, pending: Pending) -> None:
        publish = self._server.publish
        for event in pending.events:
            self._series["events"].add(*event)
        for name, frames in (("sent", pending.sent), ("received", pending.received)):
            series = self._series[name]
            series.frames += frames
            publish(series.block())
        publish(self._series["events"].pending.block())
        for t_ns, client, detections in pending.detections:
            series = self._series.setdefault(f"detections {client}", DetectionSeries(client))
            description = self._run.sensors.descriptions.get(detections.topic.partition("/")[0])
            frame_id = detections.topic if description is None else description.frame_id
            series.add(t_ns, detections, self.frame(frame_id))
            for block in series.blocks(self):
                publish(block)


def _selected(ticks: Sequence[Tick]) -> list[Tick]:
    """Return every k-th tick and the last one, each with the newest samples since the one before it."""
    if len(ticks) <= _SENT_TICKS:
        return list(ticks)
    stride = next((s for s in _STRIDES if len(ticks) <= s * (_SENT_TICKS - 1)), _STRIDES[-1])
    kept: list[Tick] = []
    newest: dict[str, Sample] = {}
    last = ticks[-1]
    for tick in ticks:
        newest |= dict(tick.released)
        if tick.truth.tick % stride == 0 or tick is last:
            kept.append(tick._replace(released=tuple(newest.items())))
            newest = {}
    return kept
