"""Detections of a CUT: boxes in a picture and objects in the world, checked before they are sent.

Boxes are in pixels of the picture, 0 at its edge; W is ENU. The bench records and shows the detections and may judge
them, but never corrects them.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Sequence

from hil_companion.errors import CutError

MAX_BOXES, MAX_OBJECTS, MAX_LABEL_LENGTH = 128, 256, 64
_LARGEST = 1e6
_NOT_PLAIN = re.compile(r"[^A-Za-z0-9_ .-]+")


@dataclass(frozen=True)
class Found:
    """One object in the world, with its position and velocity at the last sighting."""

    number: int  # identifies the object in all later messages
    label: str
    t_ns: int  # simulated
    p_W: tuple[float, float, float]
    v_W: tuple[float, float, float]
    sightings: int
    sigma_m: float


@dataclass(frozen=True)
class Detections:
    """Detections of one picture. `boxes`: `Detection`s or objects with its fields. `objects`: None if unchanged."""

    topic: str
    t_capture_ns: int
    size_px: tuple[int, int]  # width, height
    boxes: Sequence[Any] = ()
    objects: Sequence[Found] | None = None

    def as_map(self) -> dict[str, Any]:
        """Return the entries of the message, at most 128 boxes by score and the 256 newest objects. Raises CutError."""
        try:
            return self._map()
        except (AttributeError, TypeError, ValueError) as error:
            raise CutError(f"detections: {error}") from None

    def _map(self) -> dict[str, Any]:
        boxes = sorted(self.boxes, key=lambda d: -d.score)[:MAX_BOXES]
        rows = [
            [
                _label(d.label),
                _number("score", d.score, 0.0, 1.0),
                *_box(d.box_px),
                None if d.range_m is None else _number("range_m", d.range_m, 0.0),
                None if d.radial_speed_mps is None else _number("radial_speed_mps", d.radial_speed_mps),
                None if d.p_W is None else _vector("p_W", d.p_W),
            ]
            for d in boxes
        ]
        return {
            "topic": self.topic,
            "t_capture_ns": int(self.t_capture_ns),
            "size_px": [int(n) for n in self.size_px],
            "boxes": rows,
            "objects": None if self.objects is None else _objects(self.objects),
        }


def _objects(objects: Sequence[Found]) -> list[list[Any]]:
    newest = sorted(objects, key=lambda found: (-found.t_ns, found.number))[:MAX_OBJECTS]
    return [
        [
            int(found.number),
            _label(found.label),
            int(found.t_ns),
            _vector("p_W", found.p_W),
            _vector("v_W", found.v_W),
            int(found.sightings),
            _number("sigma_m", found.sigma_m, 0.0),
        ]
        for found in sorted(newest, key=lambda found: found.number)
    ]


def _label(label: Any) -> str:
    plain = _NOT_PLAIN.sub("-", str(label))[:MAX_LABEL_LENGTH]
    if not plain:
        raise CutError("detections: a label must not be empty")
    return plain


def _box(box_px: Any) -> list[float]:
    x0, y0, x1, y1 = (_number("box_px", v) for v in box_px)
    if not (x0 <= x1 and y0 <= y1):
        raise CutError(f"detections: box_px {tuple(box_px)}: x0 <= x1 and y0 <= y1 are needed")
    return [x0, y0, x1, y1]


def _vector(name: str, values: Any) -> list[float]:
    x, y, z = (_number(name, v) for v in values)
    return [x, y, z]


def _number(name: str, value: Any, low: float = -_LARGEST, high: float = _LARGEST) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not low <= number <= high:
        raise CutError(f"detections: {name} {value!r}: a finite number of sensible size is needed")
    return number
