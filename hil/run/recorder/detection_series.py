"""Detections of companions as ROS 2 messages: three topics for each client.

/companion/NAME/boxes        vision_msgs/Detection2DArray, the standard message. A result's pose is the object's
                             position in `world` as the companion estimates it; NaN without an estimate.
/companion/NAME/detections   hil_msgs/Detections: the same with range and radial speed; and the companion's list of
                             objects, in the messages that update it.
/companion/NAME/overlay      foxglove_msgs/ImageAnnotations: boxes and texts that Foxglove's image panel draws over the
                             picture with the same stamp.

header.stamp is the capture time of the picture, header.frame_id the camera's frame. The log time is the time at which
the bench received the answer.
"""

from __future__ import annotations

import math
from typing import Any

from hil.run.recorder.mcap.cdr import Layout, schema_text
from hil.run.recorder.mcap.mcap_file import Block, PendingRecords, Topics
from hil.run.recorder.mcap.topics import WORLD
from signals.detections import Detection, Detections, detection_text
from signals.samples import Vec3
from signals.time import NS_PER_S

_BOXES, _DETECTIONS = "vision_msgs/Detection2DArray", "hil_msgs/Detections"
_OVERLAY = "foxglove_msgs/ImageAnnotations"
_LINE_LOOP = 2
_YELLOW, _WHITE, _BACKGROUND, _CLEAR = (1.0, 0.83, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.6), (0.0,) * 4
_UNKNOWN_POSITION: Vec3 = (math.nan, math.nan, math.nan)


class DetectionSeries:
    """Collects the detections of one client between two chunks."""

    def __init__(self, client: str) -> None:
        self._client = client
        self._pending: list[tuple[int, Detections, str]] = []
        self._count = 0
        self._records: tuple[PendingRecords, ...] = ()

    def add(self, t_ns: int, detections: Detections, frame_id: str) -> None:
        """Add the detections in one picture; `frame_id` is the frame of its camera."""
        self._pending.append((t_ns, detections, frame_id))

    def blocks(self, file: Topics) -> list[Block]:
        """Return the records of all detections added since the last call."""
        if not self._pending:
            return []
        if not self._records:
            kinds = {"boxes": _BOXES, "detections": _DETECTIONS, "overlay": _OVERLAY}
            self._records = tuple(
                PendingRecords(file.channel(f"/companion/{self._client}/{topic}", kind, schema_text(kind)))
                for topic, kind in kinds.items()
            )
        boxes, full, overlay = self._records
        for t_ns, detections, frame_id in self._pending:
            boxes.add(t_ns, self._message(_boxes_layout(detections, frame_id, boxes.channel), t_ns, detections))
            full.add(t_ns, self._message(_full_layout(detections, frame_id, full.channel), t_ns, detections))
            overlay.add(t_ns, self._message(_overlay_layout(detections, overlay.channel), t_ns))
            self._count += 1
        self._pending.clear()
        return [records.block() for records in self._records]

    def _message(self, layout: Layout, t_ns: int, detections: Detections | None = None) -> bytes:
        record = layout.records(1)
        record["$sequence"], record["$log"], record["$publish"] = self._count, t_ns, t_ns
        if detections is not None:
            seconds, nanoseconds = divmod(detections.t_capture_ns, NS_PER_S)
            record["header.stamp.sec"], record["header.stamp.nanosec"] = seconds, nanoseconds
        return record.tobytes()


def _boxes_layout(detections: Detections, frame_id: str, channel: int) -> Layout:
    """Return the layout of one message. Each message has its own, because the labels differ in length."""
    strings = {"header.frame_id": frame_id}
    lengths = {"detections": len(detections.boxes)}
    values: dict[str, Any] = {}
    seconds, nanoseconds = divmod(detections.t_capture_ns, NS_PER_S)
    for i, detection in enumerate(detections.boxes):
        path = f"detections[{i}]"
        x0, y0, x1, y1 = detection.box_px
        strings |= {
            f"{path}.header.frame_id": WORLD,
            f"{path}.results[0].hypothesis.class_id": detection.label,
            f"{path}.id": "",
        }
        lengths[f"{path}.results"] = 1
        values |= {
            f"{path}.header.stamp.sec": seconds,
            f"{path}.header.stamp.nanosec": nanoseconds,
            f"{path}.results[0].hypothesis.score": detection.score,
            f"{path}.results[0].pose.pose.position": detection.p_W or _UNKNOWN_POSITION,
            f"{path}.results[0].pose.pose.orientation": (0.0, 0.0, 0.0, 1.0),
            f"{path}.bbox.center.position": (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
            f"{path}.bbox.size_x": x1 - x0,
            f"{path}.bbox.size_y": y1 - y0,
        }
    return Layout(_BOXES, channel=channel, strings=strings, lengths=lengths, values=values)


def _full_layout(detections: Detections, frame_id: str, channel: int) -> Layout:
    objects = detections.objects or ()
    strings = {"header.frame_id": frame_id, "topic": detections.topic}
    lengths = {"detections": len(detections.boxes), "objects": len(objects)}
    values: dict[str, Any] = {"width": detections.size_px[0], "height": detections.size_px[1]}
    for i, detection in enumerate(detections.boxes):
        path = f"detections[{i}]"
        strings[f"{path}.label"] = detection.label
        values |= {f"{path}.{name}": value for name, value in _numbers(detection).items()}
    for i, obj in enumerate(objects):
        path = f"objects[{i}]"
        seconds, nanoseconds = divmod(obj.t_ns, NS_PER_S)
        strings[f"{path}.label"] = obj.label
        values |= {
            f"{path}.number": obj.number,
            f"{path}.last_seen.sec": seconds,
            f"{path}.last_seen.nanosec": nanoseconds,
            f"{path}.position": obj.p_W,
            f"{path}.velocity": obj.v_W,
            f"{path}.sightings": obj.sightings,
            f"{path}.sigma_m": obj.sigma_m,
        }
    return Layout(_DETECTIONS, channel=channel, strings=strings, lengths=lengths, values=values)


def _numbers(detection: Detection) -> dict[str, Any]:
    x0, y0, x1, y1 = detection.box_px
    return {
        "score": detection.score,
        "box_px": (x0, y0, x1, y1),
        "range_m": math.nan if detection.range_m is None else detection.range_m,
        "radial_speed_mps": math.nan if detection.radial_speed_mps is None else detection.radial_speed_mps,
        "position": detection.p_W or _UNKNOWN_POSITION,
    }


def _overlay_layout(detections: Detections, channel: int) -> Layout:
    strings: dict[str, str] = {}
    count = len(detections.boxes)
    lengths = {"circles": 0, "points": count, "texts": count}
    seconds, nanoseconds = divmod(detections.t_capture_ns, NS_PER_S)
    values: dict[str, Any] = {}
    for i, detection in enumerate(detections.boxes):
        outline, label = f"points[{i}]", f"texts[{i}]"
        x0, y0, x1, y1 = detection.box_px
        lengths |= {f"{outline}.points": 4, f"{outline}.outline_colors": 0}
        strings[f"{label}.text"] = detection_text(detection)
        for path in (outline, label):
            values |= {f"{path}.timestamp.sec": seconds, f"{path}.timestamp.nanosec": nanoseconds}
        for k, (x, y) in enumerate(((x0, y0), (x1, y0), (x1, y1), (x0, y1))):
            values |= {f"{outline}.points[{k}].x": x, f"{outline}.points[{k}].y": y}
        values |= {
            f"{outline}.type": _LINE_LOOP,
            f"{outline}.outline_color": _YELLOW,
            f"{outline}.fill_color": _CLEAR,
            f"{outline}.thickness": 1.0,
            f"{label}.position": (x0, y0),
            f"{label}.font_size": 8.0,
            f"{label}.text_color": _WHITE,
            f"{label}.background_color": _BACKGROUND,
        }
    return Layout(_OVERLAY, channel=channel, strings=strings, lengths=lengths, values=values)
