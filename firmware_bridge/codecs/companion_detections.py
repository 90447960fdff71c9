"""Detections in an answer to a frame, as pure functions: msgpack values in and out, each validated.

{topic, t_capture_ns, size_px: [w, h], boxes: [...], objects: [...] or nil}
box      [label, score, x0, y0, x1, y1, range_m or nil, radial_speed_mps or nil, [x, y, z] or nil]
object   [number, label, t_ns, [x, y, z], [vx, vy, vz], sightings, sigma_m]
"""

from __future__ import annotations

import re
from typing import Any

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.untrusted import number, shown, whole
from signals.detections import MAX_BOXES, MAX_LABEL_LENGTH, MAX_OBJECTS, Detection, Detections, FoundObject
from signals.samples import Vec3

KEYS = ("topic", "t_capture_ns", "size_px", "boxes", "objects")
_LABEL = re.compile(rf"[A-Za-z0-9_ .-]{{1,{MAX_LABEL_LENGTH}}}")
_LARGEST = 1e6  # m, m/s, pixels
_MAX_PIXELS = 65_536  # across
_MAX_TIME_NS = 2**62
_MAX_COUNT = 2**31


def detections_from_map(values: object) -> Detections:
    """Validate and convert the map of a message. CodecError names the wrong entry."""
    if type(values) is not dict:
        raise CodecError(f"detections: {shown(values)} is not a map")
    unknown = [str(key)[:40] for key in values if key not in KEYS]
    if unknown:
        raise CodecError(f"detections: unknown entries {', '.join(sorted(unknown)[:5])}")
    topic, size = values.get("topic"), values.get("size_px")
    if type(topic) is not str or not 0 < len(topic) <= 200:
        raise CodecError(f"detections.topic: {shown(topic)} is not the name of a topic")
    if type(size) is not list or len(size) != 2:
        raise CodecError(f"detections.size_px: {shown(size)}; expected width and height")
    width, height = (_whole("size_px", n, 1, _MAX_PIXELS) for n in size)
    boxes = _rows("boxes", values.get("boxes"), 9, MAX_BOXES)
    objects = values.get("objects")
    return Detections(
        topic,
        _whole("t_capture_ns", values.get("t_capture_ns"), 0, _MAX_TIME_NS),
        (width, height),
        tuple(_box(f"boxes[{i}]", row) for i, row in enumerate(boxes)),
        None if objects is None else _objects(objects),
    )


def detections_map(detections: Detections) -> dict[str, Any]:
    """Return the map that `detections_from_map` takes."""
    objects = detections.objects
    return {
        "topic": detections.topic,
        "t_capture_ns": detections.t_capture_ns,
        "size_px": list(detections.size_px),
        "boxes": [
            [d.label, d.score, *d.box_px, d.range_m, d.radial_speed_mps, None if d.p_W is None else list(d.p_W)]
            for d in detections.boxes
        ],
        "objects": None
        if objects is None
        else [[o.number, o.label, o.t_ns, list(o.p_W), list(o.v_W), o.sightings, o.sigma_m] for o in objects],
    }


def _box(place: str, row: list[Any]) -> Detection:
    score = _number(place, row[1])
    if not 0.0 <= score <= 1.0:
        raise CodecError(f"detections.{place}: score {score:g} is not within 0..1")
    x0, y0, x1, y1 = (_number(place, v) for v in row[2:6])
    if not (x0 <= x1 and y0 <= y1):
        raise CodecError(f"detections.{place}: a box from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) has its corners swapped")
    range_m, speed_mps, p_W = (None if v is None else v for v in row[6:9])
    if range_m is not None and _number(place, range_m) < 0.0:
        raise CodecError(f"detections.{place}: range {shown(range_m)} is below 0")
    return Detection(
        _label(place, row[0]),
        score,
        (x0, y0, x1, y1),
        None if range_m is None else _number(place, range_m),
        None if speed_mps is None else _number(place, speed_mps),
        None if p_W is None else _vector(place, p_W),
    )


def _objects(values: object) -> tuple[FoundObject, ...]:
    found = []
    for i, row in enumerate(_rows("objects", values, 7, MAX_OBJECTS)):
        place = f"objects[{i}]"
        sigma_m = _number(place, row[6])
        if sigma_m < 0.0:
            raise CodecError(f"detections.{place}: sigma {sigma_m:g} m is below 0")
        found.append(
            FoundObject(
                _whole(place, row[0], 0, _MAX_COUNT),
                _label(place, row[1]),
                _whole(place, row[2], 0, _MAX_TIME_NS),
                _vector(place, row[3]),
                _vector(place, row[4]),
                _whole(place, row[5], 0, _MAX_COUNT),
                sigma_m,
            )
        )
    if len({item.number for item in found}) != len(found):
        raise CodecError("detections.objects: two objects have the same number")
    return tuple(found)


def _rows(name: str, values: object, length: int, max_rows: int) -> list[list[Any]]:
    if type(values) is not list or len(values) > max_rows:
        raise CodecError(f"detections.{name}: {shown(values)}; expected a list of at most {max_rows}")
    for i, row in enumerate(values):
        if type(row) is not list or len(row) != length:
            raise CodecError(f"detections.{name}[{i}]: {shown(row)}; expected {length} entries")
    return values


def _label(place: str, value: object) -> str:
    if type(value) is not str or not _LABEL.fullmatch(value):
        raise CodecError(
            f"detections.{place}: {shown(value)} is not a label of 1 to {MAX_LABEL_LENGTH} plain characters"
        )
    return value


def _whole(place: str, value: object, low: int, high: int) -> int:
    return whole(f"detections.{place}", value, low, high)


def _number(place: str, value: object) -> float:
    return number(f"detections.{place}", value, _LARGEST)


def _vector(place: str, value: object) -> Vec3:
    if type(value) is not list or len(value) != 3:
        raise CodecError(f"detections.{place}: {shown(value)}; expected three numbers")
    x, y, z = (_number(place, v) for v in value)
    return (x, y, z)
