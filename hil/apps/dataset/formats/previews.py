"""Preview pictures for the datasheet: a sample's channels in display colours, as file names and their bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.labels import PictureLabels
from hil.run.report.channel_images import bgr_png, channel_image
from signals.channels import CHANNELS
from signals.classes import Classes
from sim.frame.camera_model import CameraModel
from sim.radar.chirp import Chirp
from sim.radar.object_echoes import ObjectEcho

_SHOWN = ("rgb", "boxes", *(name for name in CHANNELS if name != "rgb"))
_BOX = (255, 255, 0)
_CLOUD_PX, _CLOUD_RANGE_M = 240, 40.0
_RADAR_PX = 480
_VISIBLE_DB = 13.0  # over the median; the strongest of 2048 cells of noise lies about 9 dB over it


def camera_previews(
    channels: Mapping[str, NDArray[Any]], classes: Classes, labels: PictureLabels | None = None
) -> dict[str, bytes]:
    """Return a preview of each known channel and, with `labels`, of the colour picture with boxes."""
    shown = dict(channels)
    if labels is not None:
        shown["boxes"] = with_boxes(channels["rgb"], labels)
    return dict(
        _preview(name, "rgb" if name == "boxes" else name, shown[name], classes) for name in _SHOWN if name in shown
    )


def with_boxes(rgb: NDArray[np.uint8], labels: PictureLabels) -> NDArray[np.uint8]:
    """Return a copy of `rgb`, (height, width, 3) uint8, with the outline of every box."""
    boxed = rgb.copy()
    for o in labels.objects:
        cv2.rectangle(boxed, (o.x_min, o.y_min), (o.x_max, o.y_max), _BOX)
    return boxed


def cloud_previews(
    points_L: NDArray[np.float32], segmentation: NDArray[np.uint8], classes: Classes
) -> dict[str, bytes]:
    """Return a top view of a sweep: 40 m to each side, forward is up, points have the colours of their classes.

    `points_L` is (n, 3) [m] in the LiDAR's frame, `segmentation` (n,) class ids.
    """
    top_view = np.zeros((_CLOUD_PX, _CLOUD_PX), np.uint8)
    pixel = np.floor((1.0 - points_L[:, :2] / _CLOUD_RANGE_M) * (0.5 * _CLOUD_PX)).astype(np.int64)
    in_view = ((pixel >= 0) & (pixel < _CLOUD_PX)).all(axis=1)
    top_view[pixel[in_view, 0], pixel[in_view, 1]] = segmentation[in_view]
    return dict([_preview("cloud", "segmentation", top_view, classes)])


def cell_of(o: ObjectEcho, shape: tuple[int, ...], chirp: Chirp) -> tuple[int, int]:
    """Return row and column of an object in a range-Doppler map of this shape; its speed is folded."""
    rows, columns = shape
    row = round(o.speed_mps / (2.0 * chirp.max_speed_mps) * rows) + rows // 2
    return row % rows, min(round(o.range_m / chirp.max_range_m * columns), columns - 1)


def visible_objects(
    range_doppler: NDArray[np.float32], objects: Sequence[ObjectEcho], chirp: Chirp
) -> list[tuple[ObjectEcho, float]]:
    """Return the objects whose echo stands out, with its power over the map's median [dB].

    An object stands out if the greatest power within two cells of its own is `_VISIBLE_DB` over the median, and its
    expected power, too: else the peak is another object's.
    """
    floor = float(np.median(range_doppler))
    threshold = floor * 10.0 ** (0.1 * _VISIBLE_DB)
    found = []
    for o in objects:
        row, column = cell_of(o, range_doppler.shape, chirp)
        rows = np.arange(row - 2, row + 3) % range_doppler.shape[0]
        peak = float(range_doppler[rows, max(0, column - 2) : column + 3].max())
        if floor > 0.0 and o.power_counts2 >= threshold and peak >= threshold:
            found.append((o, 10.0 * math.log10(peak / floor)))
    return found


def radar_picture(
    range_doppler: NDArray[np.float32],
    objects: Sequence[tuple[str, ObjectEcho]],
    chirp: Chirp,
    rgb: NDArray[np.uint8] | None = None,
    camera: CameraModel | None = None,
) -> bytes:
    """Return a PNG of a range-Doppler map (range upwards, speed to the right) with its visible objects marked.

    `objects`: class name and object. `rgb` and `camera`: the picture of the radar's camera at the same time, shown
    beside the map with the same marks.
    """
    db = 10.0 * np.log10(np.maximum(range_doppler, 1e-12) / max(float(np.median(range_doppler)), 1e-12))
    grey = (255.0 * np.clip(db / max(float(db.max()), _VISIBLE_DB), 0.0, 1.0)).astype(np.uint8)
    coloured = cv2.applyColorMap(np.ascontiguousarray(grey.T[::-1]), cv2.COLORMAP_INFERNO)
    shown = cv2.resize(coloured, (_RADAR_PX, _RADAR_PX), interpolation=cv2.INTER_NEAREST)
    sides = [shown]
    picture = None
    if rgb is not None and camera is not None:
        scale = _RADAR_PX / rgb.shape[0]
        size = (round(rgb.shape[1] * scale), _RADAR_PX)
        picture = cv2.resize(np.ascontiguousarray(rgb[:, :, ::-1]), size, interpolation=cv2.INTER_NEAREST)
        sides.insert(0, picture)
    rows, columns = range_doppler.shape
    names = {o: name for name, o in objects}
    in_map: list[tuple[int, int]] = []
    in_picture: list[tuple[int, int]] = []
    for o, level_db in visible_objects(range_doppler, [o for _, o in objects], chirp):
        row, column = cell_of(o, range_doppler.shape, chirp)
        text = f"{names[o]} {o.range_m:.1f} m {level_db:.0f} dB"
        _mark(shown, (row + 0.5) / rows * _RADAR_PX, (1.0 - (column + 0.5) / columns) * _RADAR_PX, text, in_map)
        if picture is not None and camera is not None:
            across, up = math.cos(o.elevation_rad), math.sin(o.elevation_rad)
            d_C = np.array([[-across * math.sin(o.azimuth_rad), -up, across * math.cos(o.azimuth_rad)]])
            x, y = (camera.project(d_C)[0] * (_RADAR_PX / camera.height)).tolist()
            _mark(picture, x, y, text, in_picture)
    return bgr_png(np.hstack(sides))


def _mark(bgr: NDArray[Any], x: float, y: float, text: str, rows_used: list[tuple[int, int]]) -> None:
    """Draw a circle at (x, y) with a text to its right or above it, within the picture.

    The text moves down until it covers none of `rows_used`: left edge and base line of the texts before.
    """
    height, width = bgr.shape[:2]
    (length, size), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    left, base = round(x + 11), round(y + 4)
    if left + length + 2 > width:
        left, base = width - length - 2, round(y - 12)
    base = min(max(base, size + 2), height - 4)
    while base + 13 < height and any(abs(left - x0) < length and abs(base - y0) < 13 for x0, y0 in rows_used):
        base += 13
    rows_used.append((left, base))
    for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.circle(bgr, (round(x), round(y)), 9, colour, thickness, cv2.LINE_AA)
        cv2.putText(bgr, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, thickness, cv2.LINE_AA)


def _preview(name: str, channel: str, array: NDArray[Any], classes: Classes) -> tuple[str, bytes]:
    kind, data = channel_image(channel, array, classes)
    return f"{name}.{kind.rpartition('/')[2]}", data
