"""Conversion of recorded messages back to pictures, point clouds, raw radar frames and detections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.run.recorder.frame_series import DATATYPES
from hil.run.recorder.reading import RecordedMessage
from signals.detections import MAX_BOXES, Detection, Detections
from signals.errors import RecordingError
from signals.time import NS_PER_S
from sim.radar.chirp import Chirp

RADAR_FRAME = "hil_msgs/RadarFrame"
IMAGE = "sensor_msgs/Image"
CLOUD = "sensor_msgs/PointCloud2"
DETECTIONS = "hil_msgs/Detections"
_PIXELS = {
    "mono8": ("u1", 1),
    "mono16": ("<u2", 1),
    "32SC1": ("<i4", 1),
    "32FC1": ("<f4", 1),
    "rgb8": ("u1", 3),
    "32FC3": ("<f4", 3),
}
_KINDS = {number: kind for kind, number in DATATYPES.items()}
_MAX_FIELDS = 64  # in a point cloud


class RecordedRadarFrame(NamedTuple):
    """One raw frame of a radar."""

    seq: int
    t_capture_ns: int
    chirp: Chirp
    raw: NDArray[np.uint16]  # (receivers, chirps, samples)


def radar_frame(message: RecordedMessage) -> RecordedRadarFrame:
    """Return the frame in a hil_msgs/RadarFrame. RecordingError if the values are impossible for a radar."""
    values = message.decode()
    shape = tuple(values[name] for name in ("receivers", "chirps", "samples"))
    data = values["data"]
    try:
        chirp = Chirp(
            center_frequency_hz=values["center_frequency_hz"],
            bandwidth_hz=values["bandwidth_hz"],
            samples=values["samples"],
            sample_rate_hz=values["sample_rate_hz"],
            chirps=values["chirps"],
            repetition_s=values["repetition_s"],
        )
        raw = np.array(data, np.uint16).reshape(shape)
    except ValueError as error:
        raise RecordingError(f"{message.topic}, frame {message.sequence}: not a valid radar frame ({error})") from error
    return RecordedRadarFrame(message.sequence, capture_ns(values), chirp, raw)


def image(message: RecordedMessage) -> tuple[int, NDArray[Any]]:
    """Return the capture time [ns] and the picture of a sensor_msgs/Image written by this bench.

    Of the sensor_msgs/CompressedImage of a data set, only colour is read.
    """
    values = message.decode()
    if "format" in values:
        return capture_ns(values), _colour(message, values)
    if values["encoding"] not in _PIXELS:
        raise RecordingError(
            f"{message.topic}: unsupported encoding {values['encoding']!r} (supported: {', '.join(_PIXELS)})"
        )
    kind, components = _PIXELS[values["encoding"]]
    shape = (values["height"], values["width"]) + ((components,) if components > 1 else ())
    try:
        picture = np.frombuffer(values["data"], kind).reshape(shape)
    except ValueError as error:
        raise RecordingError(f"{message.topic}, picture {message.sequence}: {error}") from error
    return capture_ns(values), picture.astype(picture.dtype.newbyteorder("="), copy=False)


def _colour(message: RecordedMessage, values: Mapping[str, Any]) -> NDArray[np.uint8]:
    import cv2  # only data sets need it

    bgr = cv2.imdecode(np.frombuffer(bytes(values["data"]), np.uint8), cv2.IMREAD_UNCHANGED)
    if bgr is None or bgr.ndim != 3 or not message.topic.endswith("/rgb"):
        raise RecordingError(f"{message.topic}: unsupported encoding {values['format']!r} (only colour is read)")
    return np.asarray(bgr[:, :, ::-1], np.uint8)


def cloud(message: RecordedMessage) -> tuple[int, NDArray[Any]]:
    """Return the stamp [ns], of a LiDAR the begin of the sweep, and the records of a PointCloud2 of this bench."""
    values = message.decode()
    names, formats, offsets = [], [], []
    for i in range(_MAX_FIELDS):
        if f"fields[{i}].name" not in values:
            break
        names.append(values[f"fields[{i}].name"])
        formats.append(_KINDS.get(values[f"fields[{i}].datatype"], ""))
        offsets.append(values[f"fields[{i}].offset"])
    if not all(formats):
        raise RecordingError(f"{message.topic}, cloud {message.sequence}: unknown datatype of a field")
    try:
        kind = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": values["point_step"]})
        return capture_ns(values), np.frombuffer(values["data"], kind)
    except ValueError as error:
        raise RecordingError(f"{message.topic}, cloud {message.sequence}: {error}") from error


def capture_ns(values: dict[str, Any]) -> int:
    """Return the stamp of the header [ns]."""
    return int(values["header.stamp.sec"]) * NS_PER_S + int(values["header.stamp.nanosec"])


def detections(message: RecordedMessage) -> Detections:
    """Return the boxes of a hil_msgs/Detections, without the list of objects."""
    values = message.decode()
    boxes = []
    for path in (f"detections[{i}]" for i in range(MAX_BOXES)):
        if f"{path}.label" not in values:
            break
        x0, y0, x1, y1 = (float(values[f"{path}.box_px[{k}]"]) for k in range(4))
        range_m, speed_mps = (float(values[f"{path}.{name}"]) for name in ("range_m", "radial_speed_mps"))
        boxes.append(
            Detection(
                values[f"{path}.label"],
                float(values[f"{path}.score"]),
                (x0, y0, x1, y1),
                range_m if range_m == range_m else None,  # NaN: unknown
                speed_mps if speed_mps == speed_mps else None,
            )
        )
    return Detections(values["topic"], capture_ns(values), (int(values["width"]), int(values["height"])), tuple(boxes))
