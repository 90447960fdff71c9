"""Pictures of 3-D labels for the datasheet: boxes over a camera's picture, and over a sweep from above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.boxes import SeenObject
from hil.run.report.channel_images import bgr_png
from signals.classes import Classes
from signals.rotation import matrix_of
from signals.samples import ImageSample, PointCloudSample
from sim.frame.camera_model import CameraModel
from sim.frame.object_box import ObjectBox

_WIDTH_PX = 640  # least width of a picture with boxes
_ABOVE_PX, _RANGE_M = 640, 40.0  # of the view from above
_NEAREST_M = 0.05  # parts of an edge that are nearer to the camera's plane are not drawn
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
_PARTS = 24  # of an edge, which a lens bends


def picture_with_boxes(
    picture: ImageSample, camera: CameraModel, objects: Sequence[SeenObject], classes: Classes
) -> bytes:
    """Return a PNG of the colour picture with the edges of all boxes; the side that faces forward has a cross."""
    scale = max(1, -(-_WIDTH_PX // camera.width))
    rgb = picture.channels["rgb"]
    size = (camera.width * scale, camera.height * scale)
    shown = cv2.resize(np.ascontiguousarray(rgb[:, :, ::-1]), size, interpolation=cv2.INTER_NEAREST)
    R_WC, p_WC = np.array(matrix_of(picture.q_WC)).reshape(3, 3), np.array(picture.p_WC)
    for o in sorted(objects, key=lambda o: -float(np.linalg.norm(o.box.centre_W - p_WC))):
        colour = _bgr(classes, o.label.class_id)
        corners = o.box.corners_W
        front = [(4, 7), (5, 6)]  # diagonals of the face towards the heading
        for a, b in [*_EDGES, *front]:
            share = np.linspace(0.0, 1.0, _PARTS + 1)[:, None]
            points_C = (corners[a] + share * (corners[b] - corners[a]) - p_WC) @ R_WC
            points_C[points_C[:, 2] < _NEAREST_M] = np.nan
            with np.errstate(invalid="ignore", divide="ignore"):
                line = camera.project(points_C) * scale
            for start, end in pairwise(line):
                if np.isfinite([*start, *end]).all() and np.abs([*start, *end]).max() < 1e5:
                    cv2.line(shown, _pixel(start), _pixel(end), colour, 1, cv2.LINE_AA)
    _name(shown, objects, scale, classes)
    return bgr_png(shown)


def sweep_with_boxes(
    sweep: PointCloudSample, boxes: Mapping[int, ObjectBox], class_of: Mapping[int, int], classes: Classes
) -> bytes:
    """Return a PNG of a sweep from above, 40 m each way, forward is up, with the boxes by instance.

    Points have the colours of their classes; a line from the middle of each box leads to its front.
    """
    shown = np.full((_ABOVE_PX, _ABOVE_PX, 3), 24, np.uint8)
    R_WL, p_WL = np.array(matrix_of(sweep.q_WL)).reshape(3, 3), np.array(sweep.p_WL)
    forward = R_WL[:2, 0] / max(float(np.linalg.norm(R_WL[:2, 0])), 1e-9)
    level = np.array([forward, [-forward[1], forward[0]]])  # rows: forward, left, in the plane of W

    def pixels(points_W: NDArray[Any]) -> NDArray[Any]:
        ahead_left = (points_W[:, :2] - p_WL[:2]) @ level.T
        return (1.0 - ahead_left[:, ::-1] / _RANGE_M) * (0.5 * _ABOVE_PX)

    at = np.floor(pixels(sweep.points_L.astype(np.float64) @ R_WL.T + p_WL)).astype(np.int64)
    inside = ((at >= 0) & (at < _ABOVE_PX)).all(axis=1)
    palette = np.array(classes.colours, np.uint8)[:, ::-1]
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):  # a point is 2 x 2 pixels
        x, y = np.minimum(at[inside] + (right, down), _ABOVE_PX - 1).T
        shown[y, x] = palette[sweep.segmentation[inside]]
    for instance, box in boxes.items():
        colour = _bgr(classes, class_of[instance])
        corner = pixels(box.corners_W[[0, 2, 6, 4]])
        cv2.polylines(shown, [np.round(corner).astype(np.int32)], True, colour, 1, cv2.LINE_AA)
        ends = pixels(np.array([box.centre_W, box.centre_W + 0.5 * box.size_m[0] * box.axes_W[0]]))
        cv2.line(shown, _pixel(ends[0]), _pixel(ends[1]), colour, 1, cv2.LINE_AA)
    return bgr_png(shown)


def _name(shown: NDArray[Any], objects: Sequence[SeenObject], scale: int, classes: Classes) -> None:
    """Write class, hidden share and share outside the picture over objects, the largest first, where there is room."""
    taken: list[tuple[int, int, int]] = []  # left, right, base line
    for o in sorted(objects, key=lambda o: -o.label.area_px):
        text = f"{classes.name(o.label.class_id)} {100.0 * o.occlusion:.0f}/{100.0 * o.truncation:.0f} %"
        (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.35, 1)
        left = min(max(o.label.x_min * scale, 1), max(shown.shape[1] - width - 2, 1))
        base = max(o.label.y_min * scale - 3, 10)
        if any(left < right and begin < left + width and abs(base - line) < 12 for begin, right, line in taken):
            continue
        taken.append((left, left + width, base))
        for ink, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(shown, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, 0.35, ink, thickness, cv2.LINE_AA)


def _pixel(at: NDArray[Any]) -> tuple[int, int]:
    return round(float(at[0])), round(float(at[1]))


def _bgr(classes: Classes, class_id: int) -> tuple[int, int, int]:
    """Return the display colour of a class, no darker than can be seen on a picture."""
    red, green, blue = classes.colours[class_id]
    lift = max(0, 140 - max(red, green, blue))
    return min(blue + lift, 255), min(green + lift, 255), min(red + lift, 255)
