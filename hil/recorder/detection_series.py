"""What a companion has detected, as ROS 2 messages of three topics of each client.

/companion/NAME/boxes        vision_msgs/Detection2DArray: what other tools read. A result's pose is where the thing is
                             in `world`, by the companion's own estimate; NaN where it has none.
/companion/NAME/detections   hil_msgs/Detections: the same with range and radial speed, and the objects that the
                             companion takes to be there, in messages that have news of them.
/companion/NAME/overlay      foxglove_msgs/ImageAnnotations: boxes and words, for Foxglove's image panel to draw over
                             the picture of the same stamp.

header.stamp is the picture's capture, its frame that of the camera; log time when the bench had the answer.
"""

from __future__ import annotations

import math
from typing import Any

from hil.recorder.cdr import Layout, schema_text
from hil.recorder.mcap_file import Block, McapFile, WaitingRecords
from hil.recorder.topics import WORLD
from hil.signals.detections import Detection, Detections, words_of
from hil.signals.samples import Vec3
from hil.signals.time import NS_PER_S

_BOXES, _DETECTIONS = "vision_msgs/Detection2DArray", "hil_msgs/Detections"
_OVERLAY = "foxglove_msgs/ImageAnnotations"
_LINE_LOOP = 2
_YELLOW, _WHITE, _SHADE, _CLEAR = (1.0, 0.83, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.6), (0.0,) * 4
_NOWHERE: Vec3 = (math.nan, math.nan, math.nan)


class DetectionSeries:
    """Of one client, since the last chunk."""

    def __init__(self, client: str) -> None:
        self._client = client
        self._waiting: list[tuple[int, Detections, str]] = []
        self._count = 0
        self._waiting_records: tuple[WaitingRecords, ...] = ()

    def add(self, t_ns: int, detections: Detections, frame_id: str) -> None:
        """Remember one picture's; `frame_id` is its camera's."""
        self._waiting.append((t_ns, detections, frame_id))

    def blocks(self, file: McapFile) -> list[Block]:
        """The records of everything that came in, which is then forgotten."""
        if not self._waiting:
            return []
        if not self._waiting_records:
            kinds = {"boxes": _BOXES, "detections": _DETECTIONS, "overlay": _OVERLAY}
            self._waiting_records = tuple(
                WaitingRecords(file.channel(f"/companion/{self._client}/{topic}", kind, schema_text(kind)))
                for topic, kind in kinds.items()
            )
        boxes, whole, overlay = self._waiting_records
        for t_ns, detections, frame_id in self._waiting:
            boxes.add(t_ns, self._record(_boxes_layout(detections, frame_id, boxes.channel), t_ns, detections))
            whole.add(t_ns, self._record(_whole_layout(detections, frame_id, whole.channel), t_ns, detections))
            overlay.add(t_ns, self._record(_overlay_layout(detections, overlay.channel), t_ns))
            self._count += 1
        self._waiting.clear()
        return [records.block() for records in self._waiting_records]

    def _record(self, layout: Layout, t_ns: int, stamped: Detections | None = None) -> bytes:
        record = layout.records(1)
        record["$sequence"], record["$log"], record["$publish"] = self._count, t_ns, t_ns
        if stamped is not None:
            seconds, nanoseconds = divmod(stamped.t_capture_ns, NS_PER_S)
            record["header.stamp.sec"], record["header.stamp.nanosec"] = seconds, nanoseconds
        return record.tobytes()


def _boxes_layout(detections: Detections, frame_id: str, channel: int) -> Layout:
    """Its length hangs on the labels, so each message has one of its own."""
    strings = {"header.frame_id": frame_id}
    lengths = {"detections": len(detections.boxes)}
    values: dict[str, Any] = {}
    seconds, nanoseconds = divmod(detections.t_capture_ns, NS_PER_S)
    for i, found in enumerate(detections.boxes):
        at = f"detections[{i}]"
        x0, y0, x1, y1 = found.box_px
        strings |= {f"{at}.header.frame_id": WORLD, f"{at}.results[0].hypothesis.class_id": found.label, f"{at}.id": ""}
        lengths[f"{at}.results"] = 1
        values |= {
            f"{at}.header.stamp.sec": seconds,
            f"{at}.header.stamp.nanosec": nanoseconds,
            f"{at}.results[0].hypothesis.score": found.score,
            f"{at}.results[0].pose.pose.position": found.p_W or _NOWHERE,
            f"{at}.results[0].pose.pose.orientation": (0.0, 0.0, 0.0, 1.0),
            f"{at}.bbox.center.position": (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
            f"{at}.bbox.size_x": x1 - x0,
            f"{at}.bbox.size_y": y1 - y0,
        }
    return Layout(_BOXES, channel=channel, strings=strings, lengths=lengths, values=values)


def _whole_layout(detections: Detections, frame_id: str, channel: int) -> Layout:
    objects = detections.objects or ()
    strings = {"header.frame_id": frame_id, "topic": detections.topic}
    lengths = {"detections": len(detections.boxes), "objects": len(objects)}
    values: dict[str, Any] = {"width": detections.size_px[0], "height": detections.size_px[1]}
    for i, found in enumerate(detections.boxes):
        at = f"detections[{i}]"
        strings[f"{at}.label"] = found.label
        values |= {f"{at}.{name}": value for name, value in _numbers(found).items()}
    for i, one in enumerate(objects):
        at = f"objects[{i}]"
        seconds, nanoseconds = divmod(one.t_ns, NS_PER_S)
        strings[f"{at}.label"] = one.label
        values |= {
            f"{at}.number": one.number,
            f"{at}.last_seen.sec": seconds,
            f"{at}.last_seen.nanosec": nanoseconds,
            f"{at}.position": one.p_W,
            f"{at}.velocity": one.v_W,
            f"{at}.sightings": one.sightings,
            f"{at}.sigma_m": one.sigma_m,
        }
    return Layout(_DETECTIONS, channel=channel, strings=strings, lengths=lengths, values=values)


def _numbers(found: Detection) -> dict[str, Any]:
    x0, y0, x1, y1 = found.box_px
    return {
        "score": found.score,
        "box_px": (x0, y0, x1, y1),
        "range_m": math.nan if found.range_m is None else found.range_m,
        "radial_speed_mps": math.nan if found.radial_speed_mps is None else found.radial_speed_mps,
        "position": found.p_W or _NOWHERE,
    }


def _overlay_layout(detections: Detections, channel: int) -> Layout:
    strings: dict[str, str] = {}
    count = len(detections.boxes)
    lengths = {"circles": 0, "points": count, "texts": count}
    seconds, nanoseconds = divmod(detections.t_capture_ns, NS_PER_S)
    values: dict[str, Any] = {}
    for i, found in enumerate(detections.boxes):
        outline, words = f"points[{i}]", f"texts[{i}]"
        x0, y0, x1, y1 = found.box_px
        lengths |= {f"{outline}.points": 4, f"{outline}.outline_colors": 0}
        strings[f"{words}.text"] = words_of(found)
        for at in (outline, words):
            values |= {f"{at}.timestamp.sec": seconds, f"{at}.timestamp.nanosec": nanoseconds}
        for k, (x, y) in enumerate(((x0, y0), (x1, y0), (x1, y1), (x0, y1))):
            values |= {f"{outline}.points[{k}].x": x, f"{outline}.points[{k}].y": y}
        values |= {
            f"{outline}.type": _LINE_LOOP,
            f"{outline}.outline_color": _YELLOW,
            f"{outline}.fill_color": _CLEAR,
            f"{outline}.thickness": 1.0,
            f"{words}.position": (x0, y0),
            f"{words}.font_size": 8.0,
            f"{words}.text_color": _WHITE,
            f"{words}.background_color": _SHADE,
        }
    return Layout(_OVERLAY, channel=channel, strings=strings, lengths=lengths, values=values)
