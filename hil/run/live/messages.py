"""The ROS 2 messages of each tick while the run flies, for parts that send them elsewhere.

Topics and types are those of the recording (mcap/topics.py, frame_series.py), with these in addition: `/clock`,
`/truth/odometry` and `/battery`. A message has the bytes that the recording has. A part asks in its exchange:

    sensors = run.sensors
    live = LiveMessages(tick_ns, descriptions=sensors.descriptions, deviations=sensors.deviations, vehicle=config.name)
    for message in live.of_tick(truth, released, scheduler.actuators, physics.battery):
        send(message.topic.name, message.data)

Only topics in `selected` are encoded; it may change at any time. The part names the ports that it watches
(`Part.watched_ports`), so that their sensors are computed. They are neither recorded nor part of the digest unless the
run has them anyway.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from hil.config import Bench
from hil.run.live.encoders import SampleEncoder, clock
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.frame_series import TF_STATIC, FrameSeries, add_mount
from hil.run.recorder.mcap.cdr import BlobEncoder
from hil.run.recorder.mcap.mcap_file import COMMON_TOPICS
from hil.run.recorder.mcap.topics import (
    ACTUATOR_TOPICS,
    BATTERY_TOPIC,
    MAP,
    OWN,
    SAMPLE_TOPICS,
    WORLD,
    Topic,
    live_truth_topics,
    with_variances,
)
from hil.run.recorder.radar_messages import RADAR_MESSAGES
from hil.run.sensors.frame_stages import output_ports
from signals.samples import FRAME_SAMPLES, ActuatorFrame, FrameSample, ImageSample, RadarSample, Sample, TruthState
from signals.time import NS_PER_S
from sim.physics.battery import BatteryState
from sim.sensors.catalog import KINDS

_RADAR_TYPES = {"raw": "hil_msgs/RadarFrame", "range_doppler": "sensor_msgs/Image"}
CLOCK = "/clock"


class LiveTopic(NamedTuple):
    """One topic: its name with the vehicle's, its ROS 2 type ("package/Name"), and the port that it needs."""

    name: str
    type_name: str
    port: str = ""  # "": none


class LiveMessage(NamedTuple):
    """One message. `data`: encapsulation header and CDR body."""

    topic: LiveTopic
    stamp_ns: int
    data: bytes | bytearray


class Names:
    """Names of topics and coordinate frames of one vehicle, as `VehicleTopics` makes them; of the only one: as is."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle

    def frame(self, frame_id: str) -> str:
        """Return the name of a coordinate frame."""
        return frame_id if not self._vehicle or frame_id in (WORLD, MAP) else f"{self._vehicle}/{frame_id}"

    def topic(self, path: str) -> str:
        """Return the name of a topic."""
        return path if not self._vehicle or path in COMMON_TOPICS or path == CLOCK else f"/{self._vehicle}{path}"


def live_topics(bench: Bench, tf: str = WORLD) -> tuple[LiveTopic, ...]:
    """Return the topics that a bench of one vehicle, or one vehicle of a bench, can have, before anything is built.

    `tf`: as for `live_truth_topics`.
    """
    config = bench.config
    names = Names(config.name)
    topics = [LiveTopic(CLOCK, "rosgraph_msgs/Clock")]
    rows = [row for row in live_truth_topics(tf) if not row.needs or bench.vehicle.servos] + [*ACTUATOR_TOPICS]
    topics += [LiveTopic(names.topic(f"/{row.suffix}"), row.type_name) for row in rows]
    if config.physics.effects.battery:
        topics.append(LiveTopic(names.topic(f"/{BATTERY_TOPIC.suffix}"), BATTERY_TOPIC.type_name))
    mounted = False
    for name, sensor in config.sensors.items():
        kind = KINDS[sensor.kind].sample_type
        ports = [port.name for port in output_ports(name, sensor)]
        if kind not in FRAME_SAMPLES:
            own = SAMPLE_TOPICS.get(kind, ())
            topics += [LiveTopic(names.topic(f"/{name}{row.suffix}"), row.type_name, name) for row in own]
            mounted = mounted or any(row.frame == OWN for row in own)
            continue
        mounted = True
        for port in ports:
            channel = port.partition("/")[2]
            type_name = "sensor_msgs/Image" if kind is ImageSample else "sensor_msgs/PointCloud2"
            if kind is RadarSample:
                type_name = _RADAR_TYPES.get(channel, type_name)
            topics.append(LiveTopic(names.topic(f"/{port}"), type_name, port))
            message = RADAR_MESSAGES.get(channel) if kind is RadarSample else None
            if message is not None:
                topics.append(LiveTopic(names.topic(f"/{name}/{message.topic}"), message.type_name, port))
        if kind is ImageSample:
            topics.append(LiveTopic(names.topic(f"/{name}/camera_info"), "sensor_msgs/CameraInfo", ports[0]))
        topics.append(LiveTopic(names.topic(f"/{name}/pose"), "geometry_msgs/PoseStamped", ports[0]))
    if mounted:
        topics.append(LiveTopic(TF_STATIC, "tf2_msgs/TFMessage"))
    return tuple(topics)


class _Everything:
    """Container that has everything."""

    def __contains__(self, item: object) -> bool:
        return True


class _LiveBlob:
    """A topic with the methods of `BlobTopic`."""

    def __init__(self, live: LiveMessages, name: str, type_name: str, **layout: Any) -> None:
        self._live = live
        self._topic = LiveTopic(live.names.topic(name), type_name)
        self._encoder = BlobEncoder(type_name, pad_to=live.pad_to, **layout)

    def add(self, sample: Any, log_ns: int, values: Mapping[str, Any], data: bytes = b"") -> None:  # noqa: ARG002
        encoded = self._encoder.encode(sample, values, data)
        self._live.pending.append(LiveMessage(self._topic, sample.t_capture_ns, encoded))


class _LiveRow:
    """A topic of samples that are not frames."""

    def __init__(self, row: Topic, port: str, names: Names, tick_ns: int) -> None:
        self.topic = LiveTopic(names.topic(f"/{port}{row.suffix}"), row.type_name)
        self._row = row
        self._frames = names.frame(row.frame or port), names.frame(row.child_frame)
        self._encoder: SampleEncoder | None = None  # until the first sample
        self.every = max(1, round(row.every_s * NS_PER_S / tick_ns)) if row.every_s else 1

    def has(self, sample: Any) -> bool:
        """Return True if a vehicle with such samples has the topic."""
        return not self._row.needs or len(getattr(sample, self._row.needs)) > 0

    def message(self, sample: Any, stamp_ns: int, pad_to: int) -> LiveMessage:
        """Return the message of a sample."""
        encoder = self._encoder
        if encoder is None:
            encoder = self._encoder = SampleEncoder(self._row, *self._frames, sample, pad_to)
        return LiveMessage(self.topic, stamp_ns, encoder.encode(sample, stamp_ns))


class LiveMessages:
    """Encodes what each tick has released."""

    def __init__(
        self,
        tick_ns: int,
        *,
        descriptions: Mapping[str, FrameDescription],
        deviations: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
        vehicle: str = "",
        tf: str = WORLD,
        selected: Container[str] | None = None,
        pad_to: int = 1,
    ) -> None:
        """Prepare the topics of one vehicle.

        `descriptions`: of the sensors with a mount, by port. `selected`: names of the topics to encode; None: all.
        `deviations`: of the noise of samples, by port and field. `tf`: as for `live_truth_topics`.
        `pad_to`: the bytes of a message are filled up to a multiple of this.
        """
        self.names = Names(vehicle)
        self.pad_to = pad_to
        self.pending: list[LiveMessage] = []
        self._tick_ns = tick_ns
        self._descriptions, self._deviations = descriptions, deviations
        self._selected = _Everything() if selected is None else selected
        self._clock = LiveTopic(CLOCK, "rosgraph_msgs/Clock")
        self._truth = [self._row(row) for row in live_truth_topics(tf)]
        self._actuators = [self._row(row) for row in ACTUATOR_TOPICS]
        self._battery = self._row(BATTERY_TOPIC)
        self._ports: dict[str, list[_LiveRow]] = {}
        self._frames: dict[str, FrameSeries] = {}

    def _row(self, row: Topic, port: str = "") -> _LiveRow:
        return _LiveRow(row, port, self.names, self._tick_ns)

    def _blob(self, _file: Any, path: str, type_name: str, **layout: Any) -> _LiveBlob:
        return _LiveBlob(self, path, type_name, **layout)

    def of_tick(
        self,
        truth: TruthState,
        released: Iterable[tuple[str, Sample]],
        actuators: ActuatorFrame | None = None,
        battery: BatteryState | None = None,
    ) -> list[LiveMessage]:
        """Return the messages of one tick, `/clock` first. `actuators`: the command that moved the vehicle in it."""
        selected = self._selected
        self.pending = messages = []
        t_ns, tick = truth.t_ns, truth.tick
        if CLOCK in selected:
            messages.append(LiveMessage(self._clock, t_ns, clock(t_ns)))
        self._add(self._truth, truth, t_ns, tick)
        if actuators is not None and actuators.tick >= 0:
            self._add(self._actuators, actuators, actuators.t_ns, tick)
        if battery is not None:
            self._add([self._battery], battery, t_ns, tick)
        for port, sample in released:
            if isinstance(sample, FRAME_SAMPLES):
                self._add_frame(port, sample, t_ns)
            else:
                rows = self._ports.get(port)
                if rows is None:
                    topics = with_variances(SAMPLE_TOPICS.get(type(sample), ()), self._deviations.get(port, {}))
                    rows = self._ports[port] = [self._row(row, port) for row in topics]
                    if port in self._descriptions:
                        add_mount(self._blob, self.names, self._descriptions[port], sample, t_ns)
                self._add(rows, sample, sample.t_capture_ns, 0)
        return messages

    def _add(self, rows: list[_LiveRow], sample: Any, stamp_ns: int, tick: int) -> None:
        selected = self._selected
        for row in rows:
            if row.topic.name in selected and tick % row.every == 0 and row.has(sample):
                self.pending.append(row.message(sample, stamp_ns, self.pad_to))

    def _add_frame(self, port: str, sample: FrameSample, t_ns: int) -> None:
        series = self._frames.get(port)
        if series is None:

            def wanted(path: str) -> bool:
                return self.names.topic(path) in self._selected

            series = FrameSeries(port, self._descriptions.get(port), make_topic=self._blob, wanted=wanted)
            self._frames[port] = series
        series.encode(self.names, sample, t_ns)
