"""Pictures, point clouds and radar frames as ROS 2 messages: Image, CameraInfo, PointCloud2, hil_msgs/RadarFrame.

Beside the data of a port `front` there are `/front/pose`, the sensor's pose in `world` at capture, and, once, its mount
on the vehicle in `/tf_static`. Pixels keep their type: 8- and 16-bit ids as mono8 and mono16, distances and speeds as
32FC1, normals as 32FC3. A radar's raw frames are hil_msgs/RadarFrame (uint16, by receiver, chirp and sample), its
range-Doppler maps 32FC1 pictures, its points and tracks point clouds. A message has the bytes of the sample, so the
recording equals the measurement bit for bit.

A LiDAR's cloud is stamped with the begin of its sweep, as drivers of Ouster and Velodyne sensors do, and each point has
its time since then twice: `t` (uint32, ns) as in Ouster's clouds, `time` (float32, s) as in Velodyne's.

Every field of a record array becomes a field of a point cloud. Foxglove and RViz draw a cloud by its fields x, y and z.
Therefore the coordinates of a position in a frame F (`x_F`, or the elements of `p_F_m`) get those names, and the
elements of a velocity `v_F_mps` become vx, vy, vz. The bytes of the array stay the same. Points of a radar have their
speed and signal-to-noise ratio under the names of ROS 2 drivers, too: `doppler` and `intensity`, the same bytes again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.mcap.cdr import MESSAGE_OPCODE, MESSAGE_PREFIX, RECORD_HEAD_BYTES, BlobEncoder, schema_text
from hil.run.recorder.mcap.mcap_file import Block, PendingRecords, Topics
from hil.run.recorder.mcap.topics import BODY, WORLD
from hil.run.recorder.radar_messages import RADAR_MESSAGES, RadarMessage, elements
from signals.samples import FrameSample, ImageSample, PointCloudSample, Quat, RadarSample, Vec3, arrays_of
from signals.time import NS_PER_S

TF_STATIC = "/tf_static"
IDENTITY_3X3 = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
# sensor_msgs/Image encodings: by element type and elements per pixel; three bytes are rgb
_ENCODINGS = {
    ("|u1", 1): "mono8",
    ("<u2", 1): "mono16",
    ("<i4", 1): "32SC1",
    ("<f4", 1): "32FC1",
    ("|u1", 3): "rgb8",
    ("<f4", 3): "32FC3",
}
# sensor_msgs/PointField datatypes
DATATYPES = {"|i1": 1, "|u1": 2, "<i2": 3, "<u2": 4, "<i4": 5, "<u4": 6, "<f4": 7, "<f8": 8}
_VECTORS = {"p": ("x", "y", "z"), "v": ("vx", "vy", "vz")}
_RADAR_NAMES = {"speed_mps": "doppler", "snr_db": "intensity"}  # of a record that has both
_POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "range", "t", "ring", "label", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "u1", "<f4"],
        "offsets": [0, 4, 8, 12, 16, 20, 24, 26, 28],
        "itemsize": 32,
    }
)


class BlobTopic:
    """One topic of a recording whose messages a `BlobEncoder` makes; `layout` are its arguments."""

    def __init__(self, file: Topics, topic: str, type_name: str, **layout: Any) -> None:
        self.pending = PendingRecords(file.channel(topic, type_name, schema_text(type_name)))
        self._encoder = BlobEncoder(type_name, **layout)

    def add(self, sample: Any, log_ns: int, values: Mapping[str, Any], data: bytes = b"") -> None:
        """Add one message. `values`: by path of the field, a number or a sequence of them."""
        head, tail = self._encoder.around(sample, values, data)
        length = MESSAGE_PREFIX.size - RECORD_HEAD_BYTES + len(head) + len(data) + len(tail)
        times_ns = log_ns, sample.t_available_ns
        prefix = MESSAGE_PREFIX.pack(MESSAGE_OPCODE, length, self.pending.channel, sample.seq, *times_ns)
        self.pending.add(log_ns, prefix + head, data, tail)


def add_mount(
    make_topic: Callable[..., Any], file: Any, description: FrameDescription, sample: Any, log_ns: int
) -> Any:
    """Add the mount of a sensor on the vehicle to `/tf_static`, with the times of a sample. Return the topic.

    `make_topic` takes the arguments of `BlobTopic`; `sample` has number and times.
    """
    prefix = "transforms[0]"
    topic = make_topic(
        file,
        TF_STATIC,
        "tf2_msgs/TFMessage",
        strings={
            f"{prefix}.header.frame_id": file.frame(BODY),
            f"{prefix}.child_frame_id": file.frame(description.frame_id),
        },
        lengths={"transforms": 1},
        header=f"{prefix}.header",
    )
    mount = {
        f"{prefix}.transform.translation": description.p_BC,
        f"{prefix}.transform.rotation": _xyzw(description.q_BC),
    }
    topic.add(sample, log_ns, mount)
    return topic


class FrameSeries:
    """Collects references to the samples of one camera, LiDAR or radar between two chunks. Samples never change."""

    def __init__(
        self,
        port: str,
        description: FrameDescription | None,
        *,
        make_topic: Callable[..., Any] = BlobTopic,
        wanted: Callable[[str], bool] = lambda path: True,  # noqa: ARG005
    ) -> None:
        """`make_topic` takes the arguments of `BlobTopic`. Topics are left out unless `wanted`, given their paths."""
        self._port = port
        self._make_topic, self._wanted = make_topic, wanted
        self._description = description or FrameDescription(port)
        self._pending: list[tuple[FrameSample, int]] = []
        self._topics: dict[str, BlobTopic] = {}
        self.pending_bytes = 0

    def add(self, sample: FrameSample, log_ns: int) -> None:
        """Add one sample; `log_ns` is the tick that released it."""
        self._pending.append((sample, log_ns))
        self.pending_bytes += sum(array.nbytes for _, array in arrays_of(sample))

    def blocks(self, file: Topics) -> list[Block]:
        """Return the records of all samples added since the last call."""
        for sample, log_ns in self._pending:
            self.encode(file, sample, log_ns)
        self._pending.clear()
        self.pending_bytes = 0
        return [topic.pending.block() for topic in self._topics.values()]

    def encode(self, file: Any, sample: FrameSample, log_ns: int) -> None:
        """Give the messages of one sample to the topics."""
        if "tf_static" not in self._topics:
            self._add_mount(file, sample, log_ns)
        if isinstance(sample, ImageSample):
            self._add_picture(file, sample, log_ns)
            self._add_pose(file, sample, log_ns, sample.p_WC, sample.q_WC)
        elif isinstance(sample, RadarSample):
            self._add_radar(file, sample, log_ns)
            self._add_pose(file, sample, log_ns, sample.p_WR, sample.q_WR)
        else:
            self._add_cloud(file, sample, log_ns)
            self._add_pose(file, sample, log_ns, sample.p_WL, sample.q_WL)

    def _leaves_out(self, name: str) -> bool:
        return not self._wanted(self._path(name))

    def _path(self, name: str) -> str:
        return f"/{self._port}/{name}" if name else f"/{self._port}"

    def _topic(self, file: Topics, name: str, type_name: str, **layout: Any) -> BlobTopic:
        topic = self._topics.get(name)
        if topic is None:
            topic = self._topics[name] = self._make_topic(file, self._path(name), type_name, **layout)
        return topic

    def _add_mount(self, file: Topics, sample: FrameSample, log_ns: int) -> None:
        """Add the mount of the sensor on the vehicle, once."""
        self._topics["tf_static"] = add_mount(self._make_topic, file, self._description, sample, log_ns)

    def _add_pose(self, file: Topics, sample: FrameSample, log_ns: int, p: Vec3, q: Quat) -> None:
        if self._leaves_out("pose"):
            return
        topic = self._topic(file, "pose", "geometry_msgs/PoseStamped", strings={"header.frame_id": WORLD})
        topic.add(sample, log_ns, {"pose.position": p, "pose.orientation": _xyzw(q)})

    def _add_picture(self, file: Topics, sample: ImageSample, log_ns: int) -> None:
        frame = {"header.frame_id": file.frame(self._description.frame_id)}
        for name in sorted(sample.channels):
            self._add_image(file, sample, log_ns, name, sample.channels[name])
        p = self._description.projection
        if p is not None and not self._leaves_out("camera_info"):
            topic = self._topic(
                file,
                "camera_info",
                "sensor_msgs/CameraInfo",
                strings=frame | {"distortion_model": p.distortion_model},
                lengths={"d": len(p.d)},
                values={"height": p.height, "width": p.width, "d": p.d, "k": p.k, "r": IDENTITY_3X3, "p": p.p},
            )
            topic.add(sample, log_ns, {})

    def _add_image(self, file: Topics, sample: FrameSample, log_ns: int, name: str, picture: NDArray[Any]) -> None:
        if self._leaves_out(name):
            return
        little_endian = np.ascontiguousarray(picture, picture.dtype.newbyteorder("<"))
        components = 1 if picture.ndim == 2 else picture.shape[2]
        topic = self._topic(
            file,
            name,
            "sensor_msgs/Image",
            strings={
                "header.frame_id": file.frame(self._description.frame_id),
                "encoding": _ENCODINGS[(little_endian.dtype.str, components)],
            },
            values={
                "height": picture.shape[0],
                "width": picture.shape[1],
                "step": little_endian.dtype.itemsize * components * picture.shape[1],
            },
            item_bytes=1,
        )
        topic.add(sample, log_ns, {}, little_endian.tobytes())

    def _add_radar(self, file: Topics, sample: RadarSample, log_ns: int) -> None:
        for name in sorted(sample.channels):
            array = sample.channels[name]
            if name == "raw":
                self._add_raw(file, sample, log_ns, array)
            elif array.dtype.names:
                self._add_records(file, sample, log_ns, name, array)
                message = RADAR_MESSAGES.get(name)
                if message is not None and message.fields <= set(array.dtype.names):
                    self._add_radar_message(file, sample, log_ns, message, array)
            else:
                self._add_image(file, sample, log_ns, name, array)

    def _add_raw(self, file: Topics, sample: RadarSample, log_ns: int, raw: NDArray[Any]) -> None:
        if self._leaves_out("raw"):
            return
        receivers, chirps, samples = raw.shape
        sweep = self._description.sweep
        topic = self._topic(
            file,
            "raw",
            "hil_msgs/RadarFrame",
            strings={"header.frame_id": file.frame(self._description.frame_id)},
            values={"receivers": receivers, "chirps": chirps, "samples": samples}
            | ({} if sweep is None else vars(sweep)),
            item_bytes=2,
        )
        pose = {"position": sample.p_WR, "orientation": _xyzw(sample.q_WR)}
        topic.add(sample, log_ns, pose, np.ascontiguousarray(raw, "<u2").tobytes())

    def _add_radar_message(
        self, file: Topics, sample: RadarSample, log_ns: int, message: RadarMessage, records: NDArray[Any]
    ) -> None:
        if self._leaves_out(message.topic):
            return
        frame_id = file.frame(self._description.frame_id)
        # The sequence ends the message, so its elements are inserted at the end.
        topic = self._topic(
            file,
            message.topic,
            message.type_name,
            strings={"header.frame_id": frame_id},
            lengths={message.sequence: 0},
        )
        count = {f"{message.sequence}$length": len(records)}
        topic.add(sample, log_ns, count, elements(message, records, frame_id))

    def _add_cloud(self, file: Topics, sample: PointCloudSample, log_ns: int) -> None:
        if not self._leaves_out(""):
            # The first sweep began before the run, and ROS has no times below 0.
            sweep_ns = min(self._description.sweep_ns, sample.t_capture_ns)
            begin = sample._replace(t_capture_ns=sample.t_capture_ns - sweep_ns)
            self._add_records(file, begin, log_ns, "", cloud_records(sample, sweep_ns))

    def _add_records(self, file: Topics, sample: FrameSample, log_ns: int, name: str, records: NDArray[Any]) -> None:
        if self._leaves_out(name):
            return
        topic = self._topics.get(name) or self._cloud_topic(file, name, records.dtype)
        topic.add(sample, log_ns, {"width": len(records), "row_step": records.nbytes}, records.tobytes())

    def _cloud_topic(self, file: Topics, name: str, dtype: np.dtype[Any]) -> BlobTopic:
        strings = {"header.frame_id": file.frame(self._description.frame_id)}
        values: dict[str, Any] = {"height": 1, "point_step": dtype.itemsize, "is_dense": True}
        fields = cloud_fields(dtype)
        for i, field in enumerate(fields):
            strings[f"fields[{i}].name"] = field.name
            values |= {
                f"fields[{i}].offset": field.offset,
                f"fields[{i}].datatype": field.datatype,
                f"fields[{i}].count": 1,
            }
        lengths = {"fields": len(fields)}
        return self._topic(
            file, name, "sensor_msgs/PointCloud2", strings=strings, lengths=lengths, values=values, item_bytes=1
        )


def cloud_records(sample: PointCloudSample, sweep_ns: int) -> NDArray[Any]:
    """Return the points of a LiDAR sweep, which began `sweep_ns` before its capture, as records of a PointCloud2."""
    points = np.zeros(len(sample.range_m), _POINT)
    for i, axis in enumerate("xyz"):
        points[axis] = sample.points_L[:, i]
    points["intensity"] = sample.intensity
    points["range"] = sample.range_m
    points["t"] = np.maximum(sample.time_offset_ns + np.int32(sweep_ns), 0)
    points["time"] = points["t"] * (1.0 / NS_PER_S)
    points["ring"] = sample.ring
    points["label"] = sample.segmentation
    return points


class CloudField(NamedTuple):
    """One field of a PointCloud2; `datatype` is a number of sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int


def cloud_fields(dtype: np.dtype[Any]) -> list[CloudField]:
    """Return the fields of a PointCloud2 whose points are records of this type."""
    fields = []
    for name, kind, offset in _scalars(dtype):
        fields.append(CloudField(name, offset, DATATYPES[kind.newbyteorder("<").str]))
    by_name = {field.name: field for field in fields}
    if by_name.keys() >= _RADAR_NAMES.keys():
        fields += [by_name[name]._replace(name=common) for name, common in _RADAR_NAMES.items()]
    return fields


def _scalars(dtype: np.dtype[Any]) -> Iterator[tuple[str, np.dtype[Any], int]]:
    for name in dtype.names or ():
        kind, offset = dtype.fields[name][:2]  # type: ignore[index]
        vector = re.fullmatch(r"([pv])_[A-Z](_m|_mps)?", name)
        if kind.shape == (3,) and vector:
            names: tuple[str, ...] = _VECTORS[vector[1]]
        elif kind.shape:
            names = tuple(f"{name}_{i}" for i in range(int(np.prod(kind.shape))))
        else:
            names = (re.sub(r"^([xyz])_[A-Z]$", r"\1", name),)
        for i, scalar_name in enumerate(names):
            yield scalar_name, kind.base, offset + i * kind.base.itemsize


def _xyzw(q: Quat) -> tuple[float, float, float, float]:
    return (q[1], q[2], q[3], q[0])
