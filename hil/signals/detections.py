"""What a companion made out in one picture: plain values that codecs, recorder, dashboard and judgement share.

Boxes are of the pixels of the picture: (x0, y0) the upper left corner, (x1, y1) the lower right one, 0 at the picture's
edge. W is ENU. All of it is what the companion believes, by its own estimate of where it is: never the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hil.signals.samples import Vec3

MOST_BOXES = 128  # of one picture
MOST_OBJECTS = 256  # that a companion takes to be there
LONGEST_LABEL = 64

Box = tuple[float, float, float, float]


class Detection(NamedTuple):
    """One thing in the picture."""

    label: str
    score: float  # 0 to 1
    box_px: Box
    range_m: float | None = None  # along the ray, from the camera
    radial_speed_mps: float | None = None  # + receding, as the radar has it
    p_W: Vec3 | None = None


class FoundObject(NamedTuple):
    """One thing of the world, by all sightings of it so far: where it was at `t_ns`, and how it moved."""

    number: int  # stays its own
    label: str
    t_ns: int  # simulated, of the last sighting
    p_W: Vec3
    v_W: Vec3
    sightings: int
    sigma_m: float  # of the position, horizontally, an axis


@dataclass(frozen=True)
class Detections:
    """Of one picture. `objects`: all that have been found up to it; None: as they were before."""

    topic: str  # of the picture
    t_capture_ns: int
    size_px: tuple[int, int]  # width, height
    boxes: tuple[Detection, ...] = ()
    objects: tuple[FoundObject, ...] | None = None


def words_of(found: Detection) -> str:
    """What stands beside a box."""
    words = f"{found.label} {found.score:.2f}"
    if found.range_m is not None:
        words += f", {found.range_m:.1f} m"
    if found.radial_speed_mps is not None:
        words += f", {found.radial_speed_mps:+.1f} m/s"
    return words
