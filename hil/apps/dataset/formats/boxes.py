"""3-D labels of a picture or a sweep, and their CSV file: one row per object.

Boxes are upright in W (east, north, up), tight around the object at the capture:

x, y, z [m]                     centre
length, width, height [m]       along the heading, to its left, upwards
heading [rad]                   of the object's forward axis, from east to the north
vx, vy, vz [m s^-1]             of the box's centre, as part of the object
x min .. y max [px]             of a picture: extent of the visible pixels, from 0, the last ones included
visible, alone [px]             pixels that show it, and that would without all else
occlusion, truncation []        1 - visible / alone; share of its silhouette outside the picture, as a solid angle
points, points inside []        of a sweep: points on the object; points of anything inside the box
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from hil.apps.dataset.formats.labels import Catalogue, ObjectLabel
from sim.frame.object_box import ObjectBox

FOLDER = "boxes"
_BOX = (
    "instance [],class id [],class,x [m],y [m],z [m],length [m],width [m],height [m],heading [rad],"
    "vx [m s^-1],vy [m s^-1],vz [m s^-1]"
)
PICTURE_HEADER = (
    f"{_BOX},x min [px],y min [px],x max [px],y max [px],visible [px],alone [px],occlusion [],truncation []"
)
SWEEP_HEADER = f"{_BOX},points [],points inside []"


class SeenObject(NamedTuple):
    """An object in a picture. `across`: its tight box that is upright in the camera, not in W; None: nobody asked."""

    label: ObjectLabel
    box: ObjectBox
    across: ObjectBox | None
    alone_px: int
    truncation: float  # 0 to 1

    @property
    def occlusion(self) -> float:
        """Hidden share of the pixels that the object alone would cover, 0 to 1."""
        return 1.0 - self.label.area_px / self.alone_px if self.alone_px > self.label.area_px else 0.0

    @property
    def visibility(self) -> float:
        """Visible share of the whole object, 0 to 1."""
        return (1.0 - self.occlusion) * (1.0 - self.truncation)


class SweptObject(NamedTuple):
    """An object in a sweep: points on it, and points of anything inside its box."""

    instance: int
    class_id: int
    box: ObjectBox
    points: int
    inside: int


def picture_csv(objects: Sequence[SeenObject], catalogue: Catalogue) -> bytes:
    """Return the file of one picture."""
    rows = []
    for o in objects:
        label = o.label
        rows.append(
            f"{_columns(label.instance, label.class_id, o.box, catalogue)},{label.x_min},{label.y_min},{label.x_max},"
            f"{label.y_max},{label.area_px},{o.alone_px},{o.occlusion:.4f},{o.truncation:.4f}\n"
        )
    return "".join([PICTURE_HEADER + "\n", *rows]).encode()


def sweep_csv(objects: Sequence[SweptObject], catalogue: Catalogue) -> bytes:
    """Return the file of one sweep."""
    rows = [f"{_columns(o.instance, o.class_id, o.box, catalogue)},{o.points},{o.inside}\n" for o in objects]
    return "".join([SWEEP_HEADER + "\n", *rows]).encode()


def _columns(instance: int, class_id: int, box: ObjectBox, catalogue: Catalogue) -> str:
    numbers = [*box.centre_W.tolist(), *box.size_m.tolist(), box.yaw_rad, *box.v_W.tolist()]
    return f"{instance},{class_id},{catalogue.classes.name(class_id)}," + ",".join(f"{n + 0.0:.6f}" for n in numbers)
