"""Detections of a companion in one picture: plain values shared by codecs, recorder, dashboard and verdict.

Boxes are in pixels of the picture: (x0, y0) the upper left corner, (x1, y1) the lower right one, 0 at the picture's
edge. W is ENU. Every value is the companion's estimate, based on its own estimate of its pose; none is ground truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from signals.samples import Vec3

MAX_BOXES = 128  # in one picture
MAX_OBJECTS = 256  # that a companion reports
MAX_LABEL_LENGTH = 64

Box = tuple[float, float, float, float]


class Detection(NamedTuple):
    """One object in the picture."""

    label: str
    score: float  # 0 to 1
    box_px: Box
    range_m: float | None = None  # along the ray, from the camera
    radial_speed_mps: float | None = None  # positive: receding, as measured by the radar
    p_W: Vec3 | None = None


class FoundObject(NamedTuple):
    """One object in the world, estimated from all its sightings so far: position and velocity at `t_ns`."""

    number: int  # stays the same from picture to picture
    label: str
    t_ns: int  # simulated, of the last sighting
    p_W: Vec3
    v_W: Vec3
    sightings: int
    sigma_m: float  # of the horizontal position, per axis


@dataclass(frozen=True)
class Detections:
    """Detections in one picture. `objects` are all objects found so far; None if unchanged since the last message."""

    topic: str  # of the picture
    t_capture_ns: int
    size_px: tuple[int, int]  # width, height
    boxes: tuple[Detection, ...] = ()
    objects: tuple[FoundObject, ...] | None = None


def detection_text(detection: Detection) -> str:
    """Return the label drawn beside a box: class, score, range, speed."""
    text = f"{detection.label} {detection.score:.2f}"
    if detection.range_m is not None:
        text += f", {detection.range_m:.1f} m"
    if detection.radial_speed_mps is not None:
        text += f", {detection.radial_speed_mps:+.1f} m/s"
    return text
